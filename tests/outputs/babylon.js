// Draws a glTF file with its own camera and lights, and leaves the linear picture in the page: RGBA in single precision,
// rows from the bottom. `FILE`, `WIDTH` and `HEIGHT` are set before.
addEventListener("load", async () => {
  const seen = document.createElement("pre");
  const say = bytes => {
    let text = "";
    for (const byte of bytes) text += String.fromCharCode(byte);
    seen.id = "seen";
    seen.textContent = btoa(text);
    document.body.append(seen);
  };
  try {
    const engine = new BABYLON.Engine(document.querySelector("canvas"), true);
    const scene = await BABYLON.SceneLoader.LoadAsync("", FILE, engine, null, ".glb");
    const none = new BABYLON.Color4(0, 0, 0, 0);
    // Without a tone curve, and without coding for a screen.
    scene.imageProcessingConfiguration.applyByPostProcess = true;
    scene.clearColor = none;
    scene.activeCamera = scene.cameras[0];
    const size = { width: WIDTH, height: HEIGHT };
    const type = BABYLON.Constants.TEXTURETYPE_FLOAT;
    const target = new BABYLON.RenderTargetTexture("picture", size, scene, { type, generateMipMaps: false });
    target.activeCamera = scene.cameras[0];
    target.renderList = scene.meshes;
    target.clearColor = none;
    scene.customRenderTargets.push(target);
    await scene.whenReadyAsync();
    scene.render();
    scene.render();
    const pixels = await target.readPixels();
    say(new Uint8Array(pixels.buffer, pixels.byteOffset, pixels.byteLength));
  } catch (error) {
    say(new TextEncoder().encode("error: " + (error.stack || error)));
  }
});
