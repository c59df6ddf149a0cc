// Loads a glTF file with three.js and leaves what was found in the page, as base64 of JSON: how many leaves there are,
// and how high the highest stands. `FILE` is set before.
import * as THREE from "three";
import { GLTFLoader } from "gltf-loader";

const seen = document.createElement("pre");
const say = text => {
  seen.id = "seen";
  seen.textContent = btoa(text);
  document.body.append(seen);
};
try {
  const { scene } = await new GLTFLoader().loadAsync(FILE);
  scene.updateMatrixWorld(true);
  let leaves = 0, top = -Infinity;
  const place = new THREE.Matrix4();
  scene.traverse(object => {
    if (!object.isMesh || !object.material.name.startsWith("leaf")) return;
    for (let k = 0; k < (object.isInstancedMesh ? object.count : 1); k++) {
      place.copy(object.matrixWorld);
      if (object.isInstancedMesh) {
        object.getMatrixAt(k, place);
        place.premultiply(object.matrixWorld);
      }
      leaves += 1;
      top = Math.max(top, place.elements[13]);
    }
  });
  say(JSON.stringify({ leaves, top_m: top }));
} catch (error) {
  say("error: " + (error.stack || error));
}
