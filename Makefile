# The two commands of the README, and what keeps `fits/` true.
#   make demo    a leaf scan measured, fitted, reported, rendered and checked, under out/demo/
#   make test    every test; at the end it says how many were skipped, and why
#   make fits    regenerates everything under fits/
#   make goldens draws the golden pictures of every scene anew; only after a deliberate change of a fit or the renderer
#   make gallery draws the pictures of docs/gallery.md, 1600 pixels wide, under out/gallery/; about an hour on two cores
#   make gpu     on a machine with a GPU: measures in eight minutes what needs one, into docs/evidence/gpu.csv; needs Python
#   make evidence measures what docs/evidence/measured.md shows, about half an hour alone on the machine; needs Python
#   make book    the pages of docs/ and data/ as a book, out/book/html/index.html; needs mdbook
#   make web     the viewer as a page for browsers, out/web/; docs/web.md says how scenes get there
#   make container builds the image of Containerfile with podman or docker, and tries it
#   make wheel   the Python package, under target/wheels/; `pip install target/wheels/*.whl` installs it
#   make notices lists the code and the fonts of others, docs/third-party.md; needs Python
#   make full    the demo at the full size of a real scan (720×540, 100 frames a pass); about 2 GB of disk

CARGO ?= cargo
MESOPHYLL = target/release/mesophyll

.PHONY: demo full test fits goldens gallery gpu evidence book web container notices build wheel setup setup-test fmt lint

# Says how the program ended and where to look, and ends with the program's exit code, which the shell has in `code`.
# $(1) is the report.
# Exit code 1: a fit, a picture or the machine (without an adapter to draw with) misses what the scene asks for.
# Exit code 2: an input or the disk is at fault. Larger codes: the program was stopped or crashed.
ended = if [ -e $(1) ]; then where="open $(1)"; else where="no report was written; the messages above say why"; fi; \
	case $$code in \
	    0) echo "Done: $$where" ;; \
	    1) echo "Not good: a fit, a picture or the machine missed what the scene asks for; $$where" >&2 ;; \
	    *) echo "Stopped with exit code $$code; $$where" >&2 ;; \
	esac; \
	exit $$code

demo: build
	@rm -f out/demo/report.html
	@code=0; $(MESOPHYLL) run data/scenes/demo.toml --out out/demo || code=$$?; \
	if [ $$code -le 1 ]; then \
	    if $(MESOPHYLL) fit slab --in data/leaves/species_means.csv --out out/demo/species_550nm.csv \
	        --columns rho_d=reflectance_550,rho_t=transmittance_550,h=thickness_mm --noise 2e-3; \
	    then echo "Real leaves at 550 nm are in out/demo/species_550nm.csv"; \
	    else code=$$?; fi; \
	fi; \
	$(call ended,out/demo/report.html)

full: build
	$(MESOPHYLL) synth data/leaves/balata.toml -o out/full/scan --force
	$(MESOPHYLL) fit leaf out/full/scan -o out/full/fit
	$(MESOPHYLL) report out/full/fit -o out/full/report.html

test: setup-test
	@rm -f $${CARGO_TARGET_DIR:-target}/skipped-tests.txt
	@status=0; CARGO=$(CARGO) .ci/test || status=$$?; .ci/skipped; exit $$status

fits: build
	@rm -f out/fits/report.html
	@code=0; $(MESOPHYLL) run data/scenes/fits.toml --write-fits --out out/fits || code=$$?; \
	if [ $$code -le 1 ]; then \
	    $(MESOPHYLL) fit beam --deflections data/branches/elm-twig.csv --positions axis --load even \
	        -o fits/elm-twig --out out/fits/elm-twig.csv || code=$$?; \
	fi; \
	$(call ended,out/fits/report.html)

gpu: build
	.ci/gpu $(MESOPHYLL) docs/evidence/gpu.csv

evidence: build
	.ci/evidence $(MESOPHYLL) docs/evidence/measured.csv

goldens: build
	rm -f data/scenes/golden/*.png
	for scene in data/scenes/*.toml; do \
	    $(MESOPHYLL) check $$scene --goldens-only --update-golden --out out/goldens/$$(basename $$scene .toml) || exit 1; \
	done

# A gallery that was stopped continues where it was.
gallery: build
	for scene in data/gallery/*.toml; do \
	    $(MESOPHYLL) render $$scene -o out/gallery --tone film --resume || exit $$?; \
	done

# The pages link to each other by their places in the project, so the book is made of copies in the same places.
book:
	@command -v mdbook >/dev/null || { echo "No book: mdbook is missing; cargo install mdbook brings it" >&2; exit 1; }
	@rm -rf out/book && mkdir -p out/book
	@cp -r --parents README.md CONTRIBUTING.md CITATION.cff LICENSE-APACHE LICENSE-MIT deny.toml docs \
	    $$(find data -name '*.md' -o -name leaves.toml -o -name habel-tree.toml) out/book
	@mv out/book/docs/book.toml out/book
	@sed 's|](|](docs/|; s|](docs/\.\./|](|' docs/SUMMARY.md >out/book/SUMMARY.md
	@mdbook build -d "$(CURDIR)/out/book/html" out/book

# WEB_ENV and WEB_FLAGS are for compilers that do not come from rustup (docs/web.md).
web: out = $${CARGO_TARGET_DIR:-target}
web:
	@[ -n "$(WEB_FLAGS)" ] || [ -d "$$(rustc --print sysroot)/lib/rustlib/wasm32-unknown-unknown" ] || { \
	    echo "No page: Rust's target for browsers is missing;" \
	        "\`rustup target add wasm32-unknown-unknown\` brings it" >&2; \
	    echo "(docs/web.md says how to build it without rustup)" >&2; exit 1; }
	$(WEB_ENV) $(CARGO) build --release --locked -p mesophyll-web --target wasm32-unknown-unknown $(WEB_FLAGS)
	@mkdir -p out/web
	$(CARGO) run --locked -p mesophyll-web --features bindgen --bin mesophyll-bindgen -- \
	    $(out)/wasm32-unknown-unknown/release/mesophyll_web.wasm out/web
	@cp viewer/web/page/* out/web
	@echo "Done: the page is in out/web; \`python3 -m http.server -d out/web\` serves it at http://localhost:8000"

build: setup
	$(CARGO) build --release --locked

notices:
	CARGO=$(CARGO) .ci/notices

wheel: setup
	@.ci/setup python
	@.ci/python
	@[ -x $${CARGO_TARGET_DIR:-target}/python/bin/maturin ] || \
	    { echo "No wheel: maturin, which builds it, could not be installed; the lines above say why" >&2; exit 1; }
	$${CARGO_TARGET_DIR:-target}/python/bin/maturin build --profile installed --locked --compatibility pypi -m src/outputs/python/Cargo.toml

container:
	@.ci/container

setup:
	@.ci/setup

setup-test:
	@.ci/setup test
	@.ci/setup python || [ -z "$$MESOPHYLL_REQUIRE_ALL" ]
	@.ci/python

fmt:
	$(CARGO) fmt --all

lint:
	$(CARGO) clippy --workspace --all-targets --locked -- -D warnings
	$(CARGO) clippy --no-default-features --locked -- -D warnings
