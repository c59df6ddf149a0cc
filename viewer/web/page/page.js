// The page around the viewer: it opens files, moves the camera, and shows the sliders and the reference picture. All
// pictures and all physics are the compiled viewer's.

import start, { Viewer } from "./mesophyll_web.js";

const at = (id) => document.getElementById(id);
const canvas = at("picture");

// What σ and thickness may be. Sliders are logarithmic, as in the program's window.
const RANGES = { h: [0.02, 1, "mm"], sigma_a: [1e-3, 100, "1/mm"], sigma_s: [1e-2, 300, "1/mm"] };
const CHANNELS = ["R", "G", "B"];
// Radians for a pixel that the pointer moves.
const TURN = 0.008;

let viewer = null;
let scene = null; // what the file says about itself
let slabs = []; // of each leaf, with the present edits
let view = 0;
let moved = false; // whether the camera has left the view
let stale = false;

function say(text, error = false) {
  at("message").textContent = text;
  at("message").classList.toggle("error", error);
}

// Draws once in the browser's next frame, however much has changed until then.
function redraw() {
  if (stale || !scene) return;
  stale = true;
  requestAnimationFrame(() => {
    stale = false;
    try {
      viewer.draw();
    } catch (error) {
      say(error.message, true);
    }
  });
}

// The adapter refuses things later than they are asked for.
const asking = setInterval(() => {
  let refused = null;
  try {
    refused = viewer?.refused();
  } catch {
    // After a defect, the viewer answers no more. The page shows what it said first.
    clearInterval(asking);
  }
  if (refused) say(refused[0].toUpperCase() + refused.slice(1), true);
}, 500);

export function open(bytes) {
  scene = null;
  let about;
  try {
    about = JSON.parse(viewer.load(bytes));
  } catch (error) {
    say(error.message, true);
    return;
  }
  scene = about;
  slabs = scene.leaves.map((leaf) => structuredClone(leaf.slabs));
  document.title = at("title").textContent = scene.title;
  at("about").textContent = `${scene.triangles.toLocaleString("en")} triangles; written by ${scene.program}`;
  say("");
  canvas.hidden = at("panel").hidden = false;
  at("views").replaceChildren(...scene.views.map((v, i) => button(v.name, () => look(i))));
  at("leaf").replaceChildren(...scene.leaves.map((leaf, i) => new Option(leaf.name, i)));
  at("uneditable").hidden = scene.leaves.length > 0;
  at("uneditable").textContent = "No leaf here has one σ for the whole leaf, so there is nothing to edit.";
  document.querySelector(".choice").hidden = scene.leaves.length === 0;
  at("sliders").replaceChildren();
  if (scene.leaves.length > 0) chooseLeaf();
  look(0);
}

function button(text, act) {
  const made = document.createElement("button");
  made.textContent = text;
  made.onclick = act;
  return made;
}

// Goes to the camera of a view, where its reference picture can be compared.
export function look(index) {
  view = index;
  moved = false;
  viewer.look(view);
  const [width, height] = scene.views[view].size;
  [canvas.width, canvas.height] = [width, height];
  [...at("views").children].forEach((b, i) => b.classList.toggle("chosen", i === view));
  const png = viewer.reference(view);
  at("compare").hidden = !png;
  URL.revokeObjectURL(at("reference").src);
  at("reference").src = png ? URL.createObjectURL(new Blob([png], { type: "image/png" })) : "";
  wipe(0);
  redraw();
  if (png) compare();
}

// Shows the reference picture left of a place (percent of the width).
function wipe(place) {
  at("wipe").value = place;
  at("wiped").textContent = place > 0 ? `${place} %` : "off";
  at("reference").hidden = at("edge").hidden = !(place > 0);
  at("reference").style.clipPath = `inset(0 ${100 - place}% 0 0)`;
  at("edge").style.left = `${place}%`;
}

// The bytes of the picture on the canvas. A canvas shows its picture only until the browser has presented it, so it is
// drawn again and read in the same step.
export function pixels(source = canvas) {
  if (source === canvas) viewer.draw();
  const [width, height] = scene.views[view].size;
  const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  copy.drawImage(source, 0, 0);
  return copy.getImageData(0, 0, width, height).data;
}

// Says how far the picture is from the reference, where both show the same.
export async function compare() {
  if (moved) {
    at("difference").textContent = "The camera has moved: choose the view again to compare.";
    return null;
  }
  await at("reference").decode();
  const [ours, theirs] = [pixels(), pixels(at("reference"))];
  const counts = new Array(256).fill(0);
  let sum = 0;
  for (let i = 0; i < ours.length; i += 4) {
    let largest = 0;
    for (let c = 0; c < 3; c++) largest = Math.max(largest, Math.abs(ours[i + c] - theirs[i + c]));
    counts[largest] += 1;
    sum += largest;
  }
  const all = ours.length / 4;
  let [below, quantile] = [0, 0];
  while ((below += counts[quantile]) < 0.99 * all) quantile += 1;
  const edited = slabs.some((s, i) => JSON.stringify(s) !== JSON.stringify(scene.leaves[i].slabs));
  at("difference").textContent =
    `Largest channel's difference: ${(sum / all).toFixed(2)} of 255 on average; at most ${quantile} in 99 % of the ` +
    `pixels.${edited ? " The leaf is edited; the reference is not." : ""}`;
  return { mean: sum / all, quantile };
}

function chooseLeaf() {
  const { sides } = slabs[at("leaf").value];
  const seen = ["front", "back"].filter((side) => sides[side]);
  at("side").replaceChildren(...seen.map((side) => new Option(side)));
  showSliders();
}

function showSliders() {
  const own = slabs[at("leaf").value];
  const rows = [slider("h", RANGES.h, own.thickness_mm, (v) => (own.thickness_mm = v))];
  const side = own.sides[at("side").value];
  for (const [key, name] of [["sigma_a", "σa"], ["sigma_s", "σs"]]) {
    if (!side) continue;
    CHANNELS.forEach((channel, c) => {
      rows.push(slider(`${name} ${channel}`, RANGES[key], side[key][c], (v) => (side[key][c] = v)));
    });
  }
  at("sliders").replaceChildren(...rows);
}

// A logarithmic slider of a quantity with a unit. The range includes the value that it starts with.
function slider(name, [low, high, unit], value, set) {
  const row = document.createElement("label");
  row.className = "row";
  const [from, to] = [Math.min(low, value || low), Math.max(high, value)].map(Math.log);
  row.innerHTML = `<span></span><input type="range" min="0" max="1000" step="1"><output></output>`;
  const [label, input, output] = row.children;
  label.textContent = name;
  input.value = (1000 * (Math.log(Math.max(value, Math.exp(from))) - from)) / (to - from);
  const tell = (v) => (output.textContent = `${Number(v.toPrecision(3))} ${unit}`);
  tell(value);
  input.oninput = () => {
    const now = Math.exp(from + (input.value / 1000) * (to - from));
    tell(now);
    set(now);
    edit(at("leaf").value);
  };
  return row;
}

// Sends a leaf's present numbers to the slab model.
export function edit(leaf, changed = slabs[leaf]) {
  slabs[leaf] = changed;
  try {
    viewer.edit(JSON.stringify(changed));
    say("");
  } catch (error) {
    say(error.message, true);
  }
  redraw();
  clearTimeout(edit.later);
  if (!at("compare").hidden) edit.later = setTimeout(compare, 300);
}

function reset() {
  const leaf = at("leaf").value;
  edit(leaf, structuredClone(scene.leaves[leaf].slabs));
  showSliders();
}

function left() {
  if (!moved) {
    moved = true;
    wipe(0);
    if (!at("compare").hidden) compare();
  }
  redraw();
}

function listen() {
  canvas.onpointerdown = (e) => canvas.setPointerCapture(e.pointerId);
  canvas.onpointermove = (e) => {
    if (!scene || !canvas.hasPointerCapture(e.pointerId)) return;
    const tall = canvas.clientHeight;
    if (e.shiftKey || e.buttons > 1) viewer.pan(e.movementX / tall, e.movementY / tall);
    else viewer.turn(e.movementX * TURN, e.movementY * TURN);
    left();
  };
  canvas.oncontextmenu = (e) => e.preventDefault();
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    viewer.zoom(Math.exp(-0.0015 * e.deltaY));
    left();
  }, { passive: false });
  canvas.onkeydown = (e) => {
    const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
    const zoom = { "+": 1.1, "-": 1 / 1.1 }[e.key];
    if (!scene || !(turn || zoom)) return;
    e.preventDefault();
    if (turn) viewer.turn(...turn);
    else viewer.zoom(zoom);
    left();
  };
  at("wipe").oninput = () => {
    const place = Number(at("wipe").value);
    if (moved) look(view);
    wipe(place);
  };
  at("leaf").onchange = chooseLeaf;
  at("side").onchange = showSliders;
  at("reset").onclick = reset;
  const take = async (file) => file && open(new Uint8Array(await file.arrayBuffer()));
  at("file").onchange = (e) => take(e.target.files[0]);
  const stage = at("stage");
  window.ondragover = (e) => (e.preventDefault(), stage.classList.add("over"));
  window.ondragleave = () => stage.classList.remove("over");
  window.ondrop = (e) => (e.preventDefault(), stage.classList.remove("over"), take(e.dataTransfer.files[0]));
}

// Opens the adapter, then the scene that the page's address names, as in ?scene=leaf.mesophyll.
export async function begin() {
  canvas.hidden = true;
  if (!navigator.gpu) {
    say(
      "This browser has no WebGPU, which the viewer draws with. Current versions of Chrome, Edge, Safari and Firefox " +
        "have it, on pages from https:// or from this computer (http://localhost).",
      true,
    );
    return;
  }
  try {
    await start({ module_or_path: new URL("mesophyll_web_bg.wasm", import.meta.url) });
  } catch (error) {
    say(`The compiled viewer (mesophyll_web_bg.wasm) cannot be loaded: ${error.message ?? error}`, true);
    return;
  }
  try {
    viewer = await Viewer.start(canvas);
  } catch (error) {
    say(`The scene cannot be drawn: ${error.message ?? error}.`, true);
    return;
  }
  listen();
  const named = new URLSearchParams(location.search).get("scene");
  if (!named) {
    say("Drop a scene here (a file that “mesophyll export --to web” wrote), or open one above.");
    return;
  }
  say(`Loading ${named} …`);
  try {
    const answer = await fetch(named);
    if (!answer.ok) throw new Error(`the server answers ${answer.status}`);
    open(new Uint8Array(await answer.arrayBuffer()));
  } catch (error) {
    say(`${named}: ${error.message}`, true);
  }
}

export const ready = begin();
