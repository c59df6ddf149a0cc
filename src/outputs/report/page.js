// Looking closer: zoom and pan, a wipe between two pictures, and the values of a map under the pointer.
// Maps of one side have the same texels, so they zoom together and each shows its own value at the place that one of
// them is pointed at. All that is shown is in this file; nothing is fetched.
"use strict";
(() => {
  const NONE = -(2 ** 23); // the code of a texel without a value, see values.rs
  const MOST = 64; // largest zoom
  const groups = new Map();
  const make = (name, attributes, parent) => {
    const element = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    parent.append(element);
    return element;
  };
  const scales = document.currentScript.dataset; // the colours of maps, six digits each
  const numbers = text => text.split(" ").map(Number);
  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

  // The codes of a map's values, unpacked when they are first needed.
  async function unpack(packed) {
    const bytes = Uint8Array.from(atob(packed), c => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const raw = new Uint8Array(await new Response(stream).arrayBuffer());
    const count = raw.length / 4;
    const codes = new Int32Array(count);
    for (let k = 0, before = NONE; k < count; k++) {
      const step = raw[k] + 256 * (raw[count + k] + 256 * (raw[2 * count + k] + 256 * raw[3 * count + k]));
      before += step % 2 ? -(step + 1) / 2 : step / 2;
      codes[k] = before;
    }
    return codes;
  }

  // A code as a decimal number; NaN for no value.
  function decimal(code, digits, lowest) {
    if (code === NONE) return "NaN";
    if (code === 0) return "0";
    const least = 10 ** (digits - 1);
    const place = Math.abs(code) - 1;
    const exponent = lowest + Math.floor(place / (9 * least));
    const size = Number(`${place % (9 * least) + least}e${exponent - digits + 1}`).toPrecision(digits);
    return code < 0 ? `-${size}` : size;
  }

  // Pictures of the same texels: what part of them is seen, and which texel is pointed at.
  class Group {
    constructor() {
      Object.assign(this, { members: [], x: 0, y: 0, zoom: 1, at: null });
    }
    // Zooms by a factor; the place (u, v) of the view, from 0 to 1, stays where it is.
    zoomBy(factor, u = 0.5, v = 0.5) {
      const zoom = clamp(this.zoom * factor, 1, MOST);
      this.x = u - (u - this.x) * zoom / this.zoom;
      this.y = v - (v - this.y) * zoom / this.zoom;
      this.zoom = zoom;
      this.show();
    }
    panBy(du, dv) {
      this.x += du;
      this.y += dv;
      this.show();
    }
    // Points at a texel. `follow` moves the view where the texel is outside it.
    point(at, follow) {
      this.at = at;
      if (at && follow) {
        const [u, v] = this.members[0].place(at);
        this.x += clamp(this.x + this.zoom * u, 0.1, 0.9) - (this.x + this.zoom * u);
        this.y += clamp(this.y + this.zoom * v, 0.1, 0.9) - (this.y + this.zoom * v);
      }
      this.show();
    }
    show() {
      this.x = clamp(this.x, 1 - this.zoom, 0);
      this.y = clamp(this.y, 1 - this.zoom, 0);
      for (const member of this.members) member.show();
    }
  }

  class View {
    constructor(figure) {
      const box = figure.querySelector(".view");
      const [columns, rows, step] = numbers(figure.dataset.texels);
      Object.assign(this, { figure, box, columns, rows, step, codes: null, wiped: 0.5 });
      this.images = [...box.querySelectorAll("img")];
      // The last pixels of a picture may stand for more columns and rows than there are.
      const pixel = figure.dataset.values ? numbers(figure.dataset.grid)[2] : step;
      this.wide = Math.ceil(columns / pixel) * pixel;
      this.high = Math.ceil(rows / pixel) * pixel;
      const [first] = this.images;
      figure.style.setProperty("--ratio", this.wide / this.high);
      const name = first.alt || "picture";
      const role = { tabindex: 0, role: "application", "aria-roledescription": "picture" };
      for (const [key, value] of Object.entries(role)) box.setAttribute(key, value);
      box.setAttribute("aria-label", name);
      box.setAttribute("aria-describedby", "keys");
      this.ring = make("i", { class: "ring", hidden: "" }, box);
      this.scale = box.querySelector(".scale");
      this.read = make("output", { class: "read", "aria-live": "off" }, box);
      const large = make("button", { class: "enlarge", type: "button", tabindex: -1, title: "Enlarge" }, box);
      large.setAttribute("aria-label", `Enlarge: ${name}`);
      large.textContent = "\u2922";
      large.addEventListener("click", () => enlarge(this));
      const link = figure.closest("[data-link]")?.dataset.link;
      const key = link ? `${link} ${columns} ${rows}` : this;
      if (!groups.has(key)) groups.set(key, new Group());
      this.group = groups.get(key);
      // A picture that is already on the page is not there twice.
      const other = "over" in figure.dataset && this.group.members[0]?.images[0];
      if (other) {
        first.after(other.cloneNode());
        box.classList.add("pair");
        this.images = [...box.querySelectorAll("img")];
      }
      if (this.images.length > 1) this.addWipe(figure.dataset.names.split("|"));
      this.group.members.push(this);
      this.listen();
      this.show();
    }

    // Puts a picture of every value in the place of the coarse one.
    async paint() {
      const { values, grid, range, scale } = this.figure.dataset;
      if (!values) return;
      const [columns, rows, , digits, lowest] = numbers(grid);
      const [low, high] = numbers(range);
      const colours = scales[scale].match(/../g).map(pair => parseInt(pair, 16));
      const codes = await unpack(values);
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [columns, rows];
      canvas.setAttribute("aria-hidden", "true");
      const pen = canvas.getContext("2d");
      const picture = pen.createImageData(columns, rows);
      codes.forEach((code, k) => {
        if (code === NONE) return;
        const share = (Number(decimal(code, digits, lowest)) - low) / (high - low);
        const at = 3 * clamp(Math.round(254 * share), 0, 254);
        picture.data.set([colours[at], colours[at + 1], colours[at + 2], 255], 4 * k);
      });
      pen.putImageData(picture, 0, 0);
      this.images[0].replaceWith(canvas);
      this.images[0] = canvas;
      this.figure.classList.toggle("coarse", columns < 300);
      this.codes = codes;
      this.show();
    }

    // The place of a texel's centre in the whole picture, from 0 to 1.
    place([column, row]) {
      return [(column + 0.5) / this.wide, (row + 0.5) / this.high];
    }

    // The place of the pointer in the view, from 0 to 1.
    pointer(event) {
      const box = this.box.getBoundingClientRect();
      return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    }

    addWipe([left, right]) {
      this.line = make("i", { class: "line" }, this.box);
      const label = document.createElement("label");
      label.className = "wipe";
      this.box.after(label);
      make("span", {}, label).textContent = left;
      const says = `Wipe: share of the picture that shows the ${left}; the rest shows the ${right}`;
      this.slider = make("input", { type: "range", min: 0, max: 1, step: 0.005, value: 0.5, "aria-label": says }, label);
      make("span", {}, label).textContent = right;
      this.slider.addEventListener("input", () => {
        this.wiped = Number(this.slider.value);
        this.show();
      });
    }

    listen() {
      const { box, group } = this;
      let dragged = null;
      box.addEventListener("pointerdown", event => {
        if (event.target.closest("button") || event.button > 0) return;
        box.focus({ preventScroll: true });
        dragged = this.pointer(event);
        if (event.pointerType !== "touch" || group.zoom > 1) box.setPointerCapture(event.pointerId);
      });
      box.addEventListener("pointermove", event => {
        const [u, v] = this.pointer(event);
        if (dragged) {
          group.panBy(u - dragged[0], v - dragged[1]);
          dragged = [u, v];
        }
        const column = Math.floor((u - group.x) / group.zoom * this.wide);
        const row = Math.floor((v - group.y) / group.zoom * this.high);
        group.point([clamp(column, 0, this.columns - 1), clamp(row, 0, this.rows - 1)]);
      });
      for (const end of ["pointerup", "pointercancel"]) box.addEventListener(end, () => { dragged = null; });
      box.addEventListener("pointerleave", () => group.point(null));
      box.addEventListener("dblclick", () => enlarge(this));
      box.addEventListener("wheel", event => {
        // The wheel scrolls the page as everywhere, unless the picture was chosen by a click.
        if (!event.ctrlKey && document.activeElement !== box && !this.figure.closest("dialog")) return;
        event.preventDefault();
        group.zoomBy(Math.exp(-0.002 * event.deltaY), ...this.pointer(event));
      }, { passive: false });
      box.addEventListener("keydown", event => this.key(event));
      box.addEventListener("focus", () => this.read.setAttribute("aria-live", "polite"));
      box.addEventListener("blur", () => this.read.setAttribute("aria-live", "off"));
    }

    key(event) {
      const { group } = this;
      const far = event.shiftKey ? 10 : 1;
      const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
      const move = moves[event.key];
      const centre = group.at ? this.place(group.at) : [(0.5 - group.x) / group.zoom, (0.5 - group.y) / group.zoom];
      const seen = [group.x + group.zoom * centre[0], group.y + group.zoom * centre[1]];
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      if (move) {
        const [column, row] = group.at ?? [Math.floor(centre[0] * this.wide), Math.floor(centre[1] * this.high)];
        const to = [column + far * move[0], row + far * move[1]];
        group.point([clamp(to[0], 0, this.columns - 1), clamp(to[1], 0, this.rows - 1)], true);
      } else if (event.key === "+" || event.key === "=") group.zoomBy(1.5, ...seen);
      else if (event.key === "-") group.zoomBy(1 / 1.5, ...seen);
      else if (event.key === "0") group.zoomBy(0);
      else if (event.key === "Enter") enlarge(this);
      else if (event.key === "Escape" && group.at) group.point(null);
      else return;
      event.preventDefault();
    }

    show() {
      const { group, box } = this;
      // A pixel of the picture is drawn as a square where it is larger than a few pixels of the screen.
      const sharp = group.zoom * box.clientWidth > 3 * (this.images[0].naturalWidth ?? this.images[0].width);
      for (const image of this.images) {
        image.style.transform = `translate(${100 * group.x}%, ${100 * group.y}%) scale(${group.zoom})`;
        image.classList.toggle("sharp", sharp);
      }
      if (this.scale) {
        const share = this.scale.dataset.share * group.zoom;
        this.scale.style.width = `${100 * share}%`;
        this.scale.hidden = share > 0.9;
      }
      if (this.line) {
        this.line.style.left = `${100 * this.wiped}%`;
        const cut = clamp((this.wiped - group.x) / group.zoom, 0, 1);
        this.images[1].style.clipPath = `inset(0 0 0 ${100 * cut}%)`;
      }
      this.ring.hidden = !group.at;
      if (!group.at) {
        this.read.textContent = "";
        return;
      }
      const [u, v] = this.place(group.at);
      this.ring.style.left = `${100 * (group.x + group.zoom * u)}%`;
      this.ring.style.top = `${100 * (group.y + group.zoom * v)}%`;
      this.read.textContent = this.words(group.at);
    }

    // What is known about a texel, in words.
    words([column, row]) {
      const { values, grid, unit } = this.figure.dataset;
      if (!values) {
        const shown = "shown" in this.figure.dataset ? `: ${this.colours(column, row)}` : "";
        return `column ${column}, row ${row}${shown}`;
      }
      const [columns, rows, stride, digits, lowest] = numbers(grid);
      const [i, j] = [Math.floor(column / stride), Math.floor(row / stride)];
      const place = `column ${i * stride}, row ${j * stride}`;
      if (!this.codes) return `${place}: values are not unpacked`;
      const value = decimal(this.codes[j * columns + i], digits, lowest);
      if (value === "NaN") return `${place}: no value`;
      return `${place}: ${value.replace("-", "\u2212")}${unit ? ` ${unit}` : ""}`;
    }

    // The colours that are shown at a pixel, of 255. They are the picture's own and no measurement.
    colours(column, row) {
      const canvas = document.createElement("canvas");
      canvas.width = canvas.height = 1;
      const pen = canvas.getContext("2d", { willReadFrequently: true });
      const of = image => {
        pen.drawImage(image, Math.floor(column / this.step), Math.floor(row / this.step), 1, 1, 0, 0, 1, 1);
        return [...pen.getImageData(0, 0, 1, 1).data.slice(0, 3)].join(" ");
      };
      if (this.images.length === 1) return `${of(this.images[0])} of 255`;
      const [left, right] = this.figure.dataset.names.split("|");
      return `${left} ${of(this.images[0])}, ${right} ${of(this.images[1])} of 255`;
    }
  }

  // One picture as large as the window. The figure itself moves there, and back when the dialog closes.
  const dialog = make("dialog", { "aria-label": "Enlarged picture" }, document.body);
  const bar = make("div", { class: "tools" }, dialog);
  let enlarged = null;
  const tool = (text, says, act) => {
    const button = make("button", { type: "button", "aria-label": says, title: says }, bar);
    button.textContent = text;
    button.addEventListener("click", () => act(enlarged.view.group));
  };
  tool("\u2212", "Zoom out", group => group.zoomBy(1 / 1.5));
  tool("+", "Zoom in", group => group.zoomBy(1.5));
  tool("Whole", "Show the whole picture", group => group.zoomBy(0));
  tool("Close", "Close", () => dialog.close());
  dialog.addEventListener("close", () => {
    const { view, place } = enlarged;
    place.replaceWith(view.figure);
    enlarged = null;
    view.group.show();
    view.box.focus({ preventScroll: true });
  });
  function enlarge(view) {
    if (enlarged) return;
    const place = document.createElement("span");
    view.figure.before(place);
    enlarged = { view, place };
    dialog.append(view.figure);
    dialog.showModal();
    view.group.show();
    view.box.focus();
  }

  document.documentElement.classList.add("live");
  const views = [...document.querySelectorAll("figure[data-texels]")].map(figure => new View(figure));
  // Sharpness depends on the size on screen, which a folded picture does not have yet.
  document.addEventListener("toggle", () => { for (const view of views) view.show(); }, true);
  addEventListener("load", async () => {
    for (const view of views) view.show();
    // An old browser that cannot unpack keeps the coarse pictures.
    for (const view of views) await view.paint().catch(() => {});
    document.documentElement.dataset.painted = views.length;
  });

  // Paper has no folds: everything is printed.
  let unfolded = [];
  addEventListener("beforeprint", () => {
    if (enlarged) dialog.close();
    unfolded = [...document.querySelectorAll("details:not([open]):not(.help)")];
    for (const details of unfolded) details.open = true;
  });
  addEventListener("afterprint", () => { for (const details of unfolded) details.open = false; });
})();
