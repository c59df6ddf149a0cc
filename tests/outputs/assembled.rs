//! Leaves and scenes for other renderers: read by those renderers where they are installed, and by small readers here.

use crate::common::{refused, run, succeeded};
use crate::programs::python;
use mesophyll::export::coat::ExportCoat;
use mesophyll::export::foreign::target::ExportTarget;
use mesophyll::export::scene::ExportScene;
use mesophyll::export::{ExportFormat, assemble};
use mesophyll::files::mesh::LeafMesh;
use mesophyll::optics::gloss::Lobe;
use mesophyll::optics::side::Side;
use mesophyll::transport::world::{
    ReferenceGloss, ReferenceInterior, ReferenceLeaf, ReferencePlacement, ReferenceSide, ReferenceWorld,
};
use mesophyll::transport::{ReferenceCamera, ReferenceSun};
use serde_json::{Value, json};
use std::path::Path;

/// Elements of an XML file, each opened and closed in order.
fn elements(text: &str) -> usize {
    let (mut open, mut count) = (Vec::new(), 0);
    for tag in text.split('<').skip(1) {
        let (tag, _) = tag.split_once('>').expect("a tag ends");
        if tag.starts_with(['?', '!']) {
            continue;
        }
        assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
        let name = tag.trim_start_matches('/').split([' ', '/']).next().unwrap();
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name.to_string()));
        } else {
            count += 1;
            if !tag.ends_with('/') {
                open.push(name.to_string());
            }
        }
    }
    assert!(open.is_empty(), "{open:?} stay open");
    count
}

/// A square with two texels beside each other, glossy, of another colour on each side.
fn square(lobe: Lobe) -> ReferenceWorld {
    let maps = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|c| vec![a[c], b[c]]);
    let side = |d: f32, m: f32| ReferenceSide {
        interior: ReferenceInterior::Maps {
            rho_d: maps([d, 2.0 * d, 0.5 * d], [0.5 * d, d, d]),
            rho_t: maps([0.03, 0.12, 0.02], [0.02, 0.2, 0.01]),
        },
        gloss: Some(ReferenceGloss { rho_s: maps([0.05, 0.06, 0.05], [0.04; 3]), m: vec![m, 1.3 * m] }),
        normal: None,
    };
    let corner = |x: f64, y: f64| glam::DVec3::new(x, y, 0.0);
    let mesh = LeafMesh {
        positions: vec![corner(-10.0, 10.0), corner(10.0, 10.0), corner(10.0, -10.0), corner(-10.0, -10.0)],
        normals: vec![glam::DVec3::Z; 4],
        uvs: vec![
            glam::DVec2::new(0.0, 0.0),
            glam::DVec2::new(1.0, 0.0),
            glam::DVec2::new(1.0, 1.0),
            glam::DVec2::new(0.0, 1.0),
        ],
        indices: vec![0, 2, 1, 0, 3, 2],
        ..LeafMesh::default()
    };
    let (front, back) = (side(0.08, 0.25), side(0.12, 0.4));
    ReferenceWorld {
        leaves: vec![ReferenceLeaf { mesh, width: 2, height: 1, front, back, mask: None, lobe }],
        instances: vec![ReferencePlacement { leaf: 0, transform: glam::DMat4::IDENTITY }],
        sun: Some(ReferenceSun { direction: glam::DVec3::new(0.3, 0.2, 0.9), irradiance: [3.0; 3], radius: 0.004 }),
        sky: Some([0.2, 0.3, 0.4]),
        ..ReferenceWorld::default()
    }
}

pub fn shown(lobe: Lobe) -> ExportScene {
    let camera = ReferenceCamera {
        eye: glam::DVec3::new(0.0, -30.0, 50.0),
        target: glam::DVec3::ZERO,
        up: glam::DVec3::Z,
        fov_y_deg: 30.0,
    };
    ExportScene::of_world(&square(lobe), &["a leaf".into()], camera, [24, 16], "square")
}

/// Mitsuba's own plugins give the numbers of our f64 form of them, in all directions and on both sides, and so the
/// loss that is stated is the loss that Mitsuba shows.
#[test]
fn mitsuba_shows_what_was_computed() {
    for lobe in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index: 1.5 }] {
        let folder = tempfile::tempdir().unwrap();
        let shown = shown(lobe);
        let done = assemble(&shown, ExportFormat::Mitsuba, &folder.path().join("m"), true, &[]).unwrap();
        assert!(done.files.iter().all(|f| f.is_file()), "{:?}", done.files);
        let text = std::fs::read_to_string(folder.path().join("m/scene.xml")).unwrap();
        assert!(elements(&text) > 20);
        let coat = ExportCoat::new(&shown.sheets[0], ExportTarget::Mitsuba);
        let mut asked = Vec::new();
        for k in 0..60u32 {
            let at = |a: f64| (f64::from(k) * a).fract();
            let direction = |x: f64, y: f64| {
                let z = 0.05 + 0.94 * x;
                let (sin, cos) = (std::f64::consts::TAU * y).sin_cos();
                let r = (1.0 - z * z).sqrt();
                [r * cos, r * sin, z]
            };
            let (v, l) = (direction(at(0.618034), at(0.41421)), direction(at(0.7320508), at(0.236068)));
            let (texel, side) = ((k % 2) as usize, Side::ALL[(k / 2 % 2) as usize]);
            let seen = coat.coder.seen(&coat.coded[texel][side]);
            let both = seen.both(v, l, seen.left(v));
            // Seen from the back, z points the other way.
            let up = if side == Side::Front { 1.0 } else { -1.0 };
            let turn = |d: [f64; 3], z: f64| [d[0], d[1], z * d[2]];
            let uv = [0.25 + 0.5 * f64::from(k % 2), 0.5];
            asked.push(json!([uv, turn(v, up), turn(l, up), both[0]]));
            asked.push(json!([uv, turn(v, up), turn(l, -up), both[1]]));
        }
        std::fs::write(folder.path().join("asked.json"), json!(asked).to_string()).unwrap();
        let script = "
import json, mitsuba as mi
mi.set_variant('scalar_rgb')
scene = mi.load_file('m/scene.xml')
bsdf = scene.shapes()[0].bsdf()
si = mi.SurfaceInteraction3f()
si.t, si.n, si.sh_frame = 1, mi.Normal3f(0, 0, 1), mi.Frame3f(mi.Vector3f(0, 0, 1))
si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
out = []
for uv, v, l, want in json.load(open('asked.json')):
    si.uv, si.wi = mi.Point2f(*uv), mi.Vector3f(*v)
    found = bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*l))
    out.append(max(abs(found[c] / abs(l[2]) - want[c]) / (abs(want[c]) + 1e-4) for c in range(3)))
print(json.dumps(max(out)))";
        let Some(worst) = python("mitsuba", script, folder.path()) else { return };
        // Single precision, and the scene's numbers in textures of single precision.
        assert!(worst.as_f64().unwrap() < 1e-3, "{lobe:?}: {worst}");
    }
}

/// MaterialX' own reader finds the OpenPBR materials valid.
#[test]
fn materialx_is_valid() {
    let folder = tempfile::tempdir().unwrap();
    assemble(&shown(Lobe::Beckmann), ExportFormat::Materialx, &folder.path().join("x"), true, &[]).unwrap();
    let text = std::fs::read_to_string(folder.path().join("x/leaf.mtlx")).unwrap();
    assert!(elements(&text) > 10 && text.contains("backsurfaceshader"));
    let script = "
import json, MaterialX as mx
document = mx.createDocument()
mx.readFromXmlFile(document, 'x/leaf.mtlx')
library = mx.createDocument()
mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
document.setDataLibrary(library)
good, why = document.validate()
print(json.dumps([good, why, len(document.getMaterialNodes())]))";
    let Some(said) = python("MaterialX", script, folder.path()) else { return };
    assert_eq!(said, json!([true, "", 1]));
}

/// OpenUSD's own reader sees the mesh at its place with its colours, the camera's field of view and the sun's
/// direction.
#[test]
fn usd_shows_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let mut shown = shown(Lobe::Beckmann);
    shown.places = vec![(0, glam::DMat4::from_translation(glam::DVec3::new(1.0, 2.0, 3.0))); 2];
    assemble(&shown, ExportFormat::Usd, &folder.path().join("u"), true, &[]).unwrap();
    let script = "
import json
from pxr import Usd, UsdGeom, UsdShade
stage = Usd.Stage.Open('u/scene.usda')
meshes = [p for p in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()) if p.IsA(UsdGeom.Mesh)]
world = [UsdGeom.Xformable(m).ComputeLocalToWorldTransform(0).Transform(UsdGeom.Mesh(m).GetPointsAttr().Get()[1])
         for m in meshes]
material = UsdShade.MaterialBindingAPI(meshes[0]).ComputeBoundMaterial()[0]
surface = material.ComputeSurfaceSource()[0]
camera = UsdGeom.Camera(stage.GetPrimAtPath('/World/Camera')).GetCamera(0)
sun = UsdGeom.Xformable(stage.GetPrimAtPath('/World/Sun')).ComputeLocalToWorldTransform(0).TransformDir((0, 0, 1))
print(json.dumps([[list(p) for p in world], surface.GetShaderId(), len(surface.GetInputs()), list(sun),
                  camera.GetFieldOfView(camera.FOVVertical), UsdGeom.GetStageMetersPerUnit(stage)]))";
    let Some(said) = python("pxr", script, folder.path()) else { return };
    assert_eq!(said[0], json!([[11.0, 12.0, 3.0], [11.0, 12.0, 3.0]]));
    assert_eq!((said[1].as_str().unwrap(), said[2].as_u64().unwrap()), ("UsdPreviewSurface", 4));
    let direction = shown.sun.unwrap().direction.normalize().to_array();
    assert!((0..3).all(|k| (said[3][k].as_f64().unwrap() - direction[k]).abs() < 1e-6), "{}", said[3]);
    assert!((said[4].as_f64().unwrap() - 30.0).abs() < 1e-3 && said[5] == json!(0.001), "{said}");
}

/// Blender builds the scene: its nodes, sun and camera. `pictures.rs` has its picture.
#[test]
fn blender_builds_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let shown = shown(Lobe::Beckmann);
    assemble(&shown, ExportFormat::Blender, &folder.path().join("b"), true, &[]).unwrap();
    let script = "
import contextlib, json, sys
with contextlib.redirect_stdout(sys.stderr):
    import bpy
    exec(compile(open('b/scene.py').read(), 'b/scene.py', 'exec'), {'__file__': 'b/scene.py', '__name__': 'scene'})
nodes = bpy.data.materials['a_leaf'].node_tree.nodes
kinds = [n.bl_idname for n in nodes]
sun = bpy.data.objects['sun']
bpy.context.view_layer.update()
print(json.dumps([[kinds.count('ShaderNodeBsdf' + k) for k in ('Diffuse', 'Translucent', 'Anisotropic')],
                  list(sun.matrix_world.to_3x3().col[2]), sun.data.energy,
                  [1000 * x for x in bpy.context.scene.camera.matrix_world.translation]]))";
    let Some(said) = python("bpy", script, folder.path()) else { return };
    assert_eq!(said[0], json!([2, 2, 2]));
    let close = |found: &Value, wanted: [f64; 3]| {
        assert!((0..3).all(|k| (found[k].as_f64().unwrap() - wanted[k]).abs() < 1e-3), "{found} {wanted:?}");
    };
    close(&said[1], shown.sun.unwrap().direction.normalize().to_array());
    close(&said[3], shown.camera.eye.to_array());
    assert_eq!(said[2], json!(3.0));
}

/// pbrt's file names only materials and textures that it declares before, and files that are there.
/// Three stops darker than the light is: Blender and USD are told, the others' lists of what is lost name it.
#[test]
fn an_exposure_goes_along_or_is_named() {
    let dark = ExportScene { exposure: 0.125, ..shown(Lobe::Beckmann) };
    let folder = tempfile::tempdir().unwrap();
    let write = |format: ExportFormat, name: &str, file: &str| {
        let path = folder.path().join(name);
        let lost = assemble(&dark, format, &path, true, &[]).unwrap().lost.unwrap();
        let text = std::fs::read(if file.is_empty() { path } else { path.join(file) }).unwrap();
        (String::from_utf8_lossy(&text).into_owned(), lost.lines().join("\n"))
    };
    let (script, lost) = write(ExportFormat::Blender, "blender", "scene.py");
    assert!(script.contains("\\\"stops\\\":-3.0") && script.contains("view_settings.exposure = DATA[\"stops\"]"));
    assert!(!lost.contains("stops"), "{lost}");
    let (text, lost) = write(ExportFormat::Usd, "usd", "scene.usda");
    assert!(text.contains("float exposure = -3") && !lost.contains("stops"), "{lost}");
    for (format, name, file) in [
        (ExportFormat::Mitsuba, "m", "scene.xml"),
        (ExportFormat::Pbrt, "p", "scene.pbrt"),
        (ExportFormat::GltfTranslucent, "g.glb", ""),
    ] {
        let (text, lost) = write(format, name, file);
        assert!(lost.contains("-3.00 stops"), "{name}: {lost}");
        assert!(name != "g.glb" || text.contains("\"exposure_stops\":-3.0"));
    }
}

#[test]
fn pbrt_declares_what_it_names() {
    let folder = tempfile::tempdir().unwrap();
    let done = assemble(&shown(Lobe::Ggx), ExportFormat::Pbrt, &folder.path().join("p"), true, &[]).unwrap();
    let text = std::fs::read_to_string(&done.files[0]).unwrap();
    assert_eq!(text.matches('[').count(), text.matches(']').count());
    let mut known: Vec<&str> = Vec::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split('"').collect();
        if line.starts_with("Texture ") || line.starts_with("MakeNamedMaterial ") || line.starts_with("ObjectBegin ") {
            known.push(words[1]);
        }
        for (k, word) in words.iter().enumerate() {
            if word.starts_with("texture ") {
                assert!(known.contains(&words[k + 2]), "{line}");
            }
            if *word == "string filename" && words[k + 2] != "scene.exr" {
                assert!(folder.path().join("p").join(words[k + 2]).is_file(), "{line}");
            }
        }
        if line.starts_with("NamedMaterial ") || line.starts_with("ObjectInstance ") {
            assert!(known.contains(&words[1]), "{line}");
        }
    }
    assert_eq!(text.matches("AttributeBegin").count(), text.matches("AttributeEnd").count());
    assert!(text.contains("\"mix\"") && text.contains("diffusetransmission"));
}

/// A whole scene as glTF has its leaves, its camera and its sun where they stand; nothing is required of a reader.
#[test]
fn a_whole_scene_is_a_gltf() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("s.glb").display().to_string();
    succeeded(&run(["export", "data/scenes/cluster.toml", "--to", "gltf-translucent", "-o", &out]));
    let (document, ..) = gltf::import(&out).unwrap();
    assert_eq!(document.extensions_required().count(), 0);
    assert!(document.extensions_used().any(|e| e == "KHR_materials_diffuse_transmission"));
    assert_eq!((document.cameras().count(), document.meshes().count()), (1, 2));
    let root = document.default_scene().unwrap().nodes().next().unwrap();
    let leaves: Vec<_> = root.children().filter(|n| n.mesh().is_some()).collect();
    assert_eq!(leaves.len(), 14);
    let turn = glam::Mat4::from_cols_array_2d(&root.transform().matrix());
    let eye = root.children().find(|n| n.camera().is_some()).unwrap();
    let place = turn * glam::Mat4::from_cols_array_2d(&eye.transform().matrix());
    // The scene's eye is at (120, −330, 120) mm with z up: y up has (x, z, −y), in metres.
    assert!((place.col(3).truncate() - glam::Vec3::new(0.12, 0.12, 0.33)).length() < 1e-6, "{place}");
    let lost: Value = serde_json::from_slice(&std::fs::read(folder.path().join("s.glb.loss.json")).unwrap()).unwrap();
    assert_eq!(lost["surfaces"].as_array().unwrap().len(), 2);
    let said = lost["left_out"].to_string();
    assert!(said.contains("sky") && said.contains("sun"), "{said}");
    if let Some(said) = crate::plants::validated(Path::new(&out)) {
        assert_eq!(said, "0 0");
    }
}

#[test]
fn what_cannot_be_exported_as_a_whole_is_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("x").display().to_string();
    let scene = "data/scenes/front-lit.toml";
    refused(&run(["export", scene, "--to", "mitsuba", "--view", "nothing", "-o", &out]), 2, &["nothing", "front"]);
    refused(&run(["export", scene, "--to", "gltf", "--view", "front", "-o", &out]), 2, &["--view"]);
    refused(
        &run(["export", scene, "--to", "mitsuba", "--from", "0", "--until", "1", "-o", &out]),
        2,
        &["holds one time"],
    );
    refused(&run(["export", scene, "--to", "csv", "-o", &out]), 2, &["is a scene", "mitsuba"]);
    assert!(!Path::new(&out).exists());
}

/// A scene whose leaf has no fit would lose this leaf silently.
#[test]
fn a_leaf_without_a_fit_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(root.join("data/scenes/front-lit.toml")).unwrap();
    let leaves = root.join("data/leaves").display().to_string();
    let unfitted: Vec<String> =
        text.lines().filter(|l| !l.starts_with("fit =")).map(|l| l.replace("../leaves", &leaves)).collect();
    let scene = folder.path().join("s.toml");
    std::fs::write(&scene, unfitted.join("\n")).unwrap();
    let out = folder.path().join("m").display().to_string();
    refused(
        &run(["export", &scene.display().to_string(), "--to", "mitsuba", "-o", &out]),
        2,
        &["not fitted", "mesophyll run"],
    );
    assert!(!Path::new(&out).exists());
}

/// The exposure goes to Blender as stops (1/8 is −3 of them), and is named where the format has no place for it.
#[test]
fn the_exposure_is_handed_over_or_named() {
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(root.join("data/scenes/front-lit.toml")).unwrap();
    let text: Vec<String> = text
        .lines()
        .filter(|l| !l.starts_with("exposure"))
        .map(|l| l.replace("../../", &format!("{}/", root.display())))
        .map(|l| l.replace("\"../", &format!("\"{}/", root.join("data").display())))
        .map(|l| if l == "schema = 1" { format!("{l}\nexposure = 0.125") } else { l })
        .collect();
    let scene = folder.path().join("s.toml");
    std::fs::write(&scene, text.join("\n")).unwrap();
    let scene = scene.display().to_string();
    for (format, out) in [("blender", "blender"), ("gltf-translucent", "s.glb"), ("usd", "usd")] {
        let out = folder.path().join(out).display().to_string();
        succeeded(&run(["export", &scene, "--to", format, "-o", &out]));
    }
    let script = std::fs::read_to_string(folder.path().join("blender/scene.py")).unwrap();
    assert!(script.contains("\\\"stops\\\":-3.0") && script.contains("view_settings.exposure"), "no exposure");
    let lost = std::fs::read_to_string(folder.path().join("s.glb.loss.json")).unwrap();
    assert!(lost.contains("-3.00 stops"), "{lost}");
    let usd = std::fs::read_to_string(folder.path().join("usd/scene.usda")).unwrap();
    assert!(usd.contains("float exposure = -3"), "no exposure");
}
