// Runs beside the page in the test, and posts what the test compares.

import { compare, edit, pixels, ready } from "./page.js";

const post = (what, body) => fetch(what, { method: "POST", body });

try {
  const adapter = await navigator.gpu?.requestAdapter();
  await post("adapter", adapter ? adapter.info.vendor : "none");
  if (adapter) {
    await ready;
    const message = document.getElementById("message").textContent;
    if (message) throw new Error(message);
    const before = pixels();
    const { mean, quantile } = await compare();
    await post("picture", before);
    const slab = { sigma_a: [2.5, 0.8, 3.0], sigma_s: [11.0, 12.0, 10.0] };
    edit(0, { material: 0, thickness_mm: 0.28, sides: { front: slab, back: slab } });
    await post("edited", pixels());
    await post("compared", `${mean} ${quantile}`);
  }
} catch (error) {
  await post("failed", String(error));
}
