# The two commands of the README, and what keeps `fits/` true.
#   make demo    a leaf scan measured, fitted, reported, rendered and checked, under out/demo/
#   make test    every test; at the end it says how many were skipped, and why
#   make fits    regenerates everything under fits/
#   make goldens draws the golden pictures of every scene anew; only after a deliberate change of a fit or of the renderer
#   make full    the demo at the full size of a real scan (720×540, 100 frames a pass); about 2 GB of disk

CARGO ?= cargo
MESOPHYLL = target/release/mesophyll

.PHONY: demo full test fits goldens build setup setup-test fmt lint

demo: build
	$(MESOPHYLL) run data/scenes/demo.toml --out out/demo || [ $$? -eq 1 ] # 1: a picture missed a threshold; the report says which
	$(MESOPHYLL) fit slab --in data/leaves/species_means.csv --out out/demo/species_550nm.csv \
	    --columns rho_d=reflectance_550,rho_t=transmittance_550,h=thickness_mm --noise 2e-3
	@echo "Done: open out/demo/report.html; real leaves at 550 nm are in out/demo/species_550nm.csv"

full: build
	$(MESOPHYLL) synth data/leaves/balata.toml -o out/full/scan --force
	$(MESOPHYLL) fit leaf out/full/scan -o out/full/fit
	$(MESOPHYLL) report out/full/fit -o out/full/report.html

test: setup-test
	@rm -f $${CARGO_TARGET_DIR:-target}/skipped-tests.txt
	@status=0; $(CARGO) test --workspace --locked || status=$$?; .ci/skipped; exit $$status

fits: build
	$(MESOPHYLL) run data/scenes/fits.toml --write-fits --out out/fits || [ $$? -eq 1 ]
	$(MESOPHYLL) fit beam --deflections data/branches/elm-twig.csv --positions axis -o fits/elm-twig --out out/fits/elm-twig.csv

goldens: build
	rm -f data/scenes/golden/*.png
	for scene in data/scenes/*.toml; do \
	    $(MESOPHYLL) check $$scene --goldens-only --update-golden --out out/goldens/$$(basename $$scene .toml) || exit 1; \
	done

build: setup
	$(CARGO) build --release --locked

setup:
	@.ci/setup

setup-test:
	@.ci/setup test

fmt:
	$(CARGO) fmt --all

lint:
	$(CARGO) clippy --workspace --all-targets --locked -- -D warnings
