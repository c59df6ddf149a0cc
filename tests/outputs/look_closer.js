// Added to a report by `look_closer.rs`: does what a reader does, and leaves what was seen in the page.
addEventListener("load", async () => {
  const seen = {};
  const wait = () => new Promise(done => setTimeout(done, 20));
  for (let k = 0; k < 500 && !document.documentElement.dataset.painted; k++) await wait();
  const all = [...document.querySelectorAll("figure[data-values] .view")];
  const visible = all.filter(view => view.clientWidth > 0);
  const read = view => view.querySelector("output").textContent;
  const drawn = view => view.querySelector("canvas, img");
  // Where a texel's centre is on the screen.
  const at = (view, column, row) => {
    const [columns, rows, stride] = view.parentElement.dataset.grid.split(" ").map(Number);
    const box = view.getBoundingClientRect();
    return {
      clientX: box.left + box.width * (column + 0.5) / (columns * stride),
      clientY: box.top + box.height * (row + 0.5) / (rows * stride),
    };
  };
  const pointer = (view, name, place) =>
    view.dispatchEvent(new PointerEvent(name, { bubbles: true, pointerId: 1, ...place }));
  const key = (view, name, more) =>
    view.dispatchEvent(new KeyboardEvent("keydown", { key: name, bubbles: true, cancelable: true, ...more }));

  // Values under the pointer.
  seen.values = [];
  for (const view of visible) {
    for (const [column, row] of [[36, 27], [20, 30], [50, 24], [0, 0], [41, 22]]) {
      pointer(view, "pointermove", at(view, column, row));
      seen.values.push({ label: view.getAttribute("aria-label"), column, row, text: read(view) });
    }
  }
  for (const view of visible) pointer(view, "pointerleave", {});
  pointer(visible[0], "pointermove", at(visible[0], 36, 27));
  seen.linked = visible.filter(read).length;
  pointer(visible[0], "pointerleave", {});
  seen.left = visible.filter(read).length;

  // Keys: ten texels to the right and one down from the middle, zoom, the whole again.
  const [first, second] = visible;
  first.focus();
  key(first, "ArrowRight", { shiftKey: true });
  key(first, "ArrowDown");
  seen.walked = read(first);
  seen.live = first.querySelector("output").getAttribute("aria-live");
  seen.whole = drawn(first).style.transform;
  key(first, "+");
  seen.zoomed = [drawn(first).style.transform, drawn(second).style.transform];
  seen.kept = read(first);
  // A drag by a tenth of the picture to the right.
  const box = first.getBoundingClientRect();
  const from = { clientX: box.left + 0.5 * box.width, clientY: box.top + 0.5 * box.height };
  try { first.setPointerCapture = () => {}; } catch { }
  pointer(first, "pointerdown", from);
  pointer(first, "pointermove", { ...from, clientX: from.clientX + 0.1 * box.width });
  pointer(first, "pointerup", from);
  seen.dragged = drawn(first).style.transform;
  const scroll = { deltaY: -500, cancelable: true, ...from };
  seen.wheel = !first.dispatchEvent(new WheelEvent("wheel", scroll)) && drawn(first).style.transform;
  key(first, "0");
  seen.again = drawn(first).style.transform;
  first.blur();
  seen.scrolls = first.dispatchEvent(new WheelEvent("wheel", scroll)) && drawn(first).style.transform;

  // The wipe.
  const pair = document.querySelector(".view.pair");
  const slider = pair.parentElement.querySelector("input[type=range]");
  seen.wipe = [0.5, 0.25, 0, 1].map(share => {
    slider.value = share;
    slider.dispatchEvent(new Event("input"));
    return [pair.querySelectorAll("img")[1].style.clipPath, pair.querySelector(".line").style.left];
  });
  seen.slider = slider.getAttribute("aria-label");

  // Enlarged, and back.
  const figure = first.parentElement;
  const [home, width] = [figure.parentElement, first.clientWidth];
  first.focus();
  key(first, "Enter");
  await wait();
  const dialog = document.querySelector("dialog");
  seen.large = [dialog.open, dialog.contains(figure), first.clientWidth > 1.5 * width];
  seen.tools = [...dialog.querySelectorAll(".tools button")].map(b => b.getAttribute("aria-label"));
  dialog.querySelector(".tools button:nth-child(2)").click();
  seen.largeZoom = drawn(first).style.transform;
  dialog.close();
  // The browser tells the page of it with a later frame.
  for (let k = 0; k < 100 && dialog.contains(figure); k++) await new Promise(requestAnimationFrame);
  seen.back = [dialog.open, figure.parentElement === home, document.activeElement === first];

  // Everything that can be used has a name and can be reached.
  const usable = [...document.querySelectorAll("a[href], button, input, summary, [role=application]")];
  const name = e => e.getAttribute("aria-label") || e.textContent.trim();
  seen.unnamed = usable.filter(e => !name(e)).length;
  seen.unreachable = usable.filter(e => e.tabIndex < 0 && !e.classList.contains("enlarge")).length;
  seen.usable = usable.length;
  first.focus();
  const style = getComputedStyle(first);
  seen.outline = [style.outlineStyle, style.outlineWidth];

  // Paper: what is folded is printed.
  const folded = () => document.querySelectorAll("details:not([open]):not(.help)").length;
  const before = folded();
  dispatchEvent(new Event("beforeprint"));
  seen.folded = [before > 0, folded()];
  dispatchEvent(new Event("afterprint"));
  seen.folded.push(folded() === before);

  const out = document.createElement("pre");
  out.id = "seen";
  out.textContent = btoa(unescape(encodeURIComponent(JSON.stringify(seen))));
  document.body.append(out);
});
