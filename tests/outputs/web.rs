//! A scene and a fit as files for the viewer in a browser.

use crate::common::{run, succeeded};
use mesophyll_fits::leaf_folder::LeafFit;
use mesophyll_viewer::scene::{Instance, Interior, SlabCurve};
use mesophyll_web::bundle::Bundle;

/// Linear interpolation in the curve, for the first channel.
fn at(curve: &SlabCurve, h: f32) -> [f32; 2] {
    let last = curve.rho_d.len() - 1;
    let x = ((h - curve.min_mm) / (curve.max_mm - curve.min_mm)).clamp(0.0, 1.0) * last as f32;
    let k = (x as usize).min(last - 1);
    let mix = |list: &[[f32; 3]]| list[k][0] + (x - k as f32) * (list[k + 1][0] - list[k][0]);
    [mix(&curve.rho_d), mix(&curve.rho_t)]
}

#[test]
fn a_scene_for_the_browser_has_its_reference_and_its_slabs() {
    let folder = tempfile::tempdir().unwrap();
    let (out, pictures) = (folder.path().join("s.mesophyll"), folder.path().join("run"));
    std::fs::create_dir(&pictures).unwrap();
    let drawn = pictures.join("glance-reference.png");
    image::RgbaImage::from_pixel(800, 600, image::Rgba([9, 8, 7, 255])).save(&drawn).unwrap();
    let [to, with] = [&out, &pictures].map(|p| p.display().to_string());
    let exported = |scene: &str| {
        succeeded(&run(["export", scene, "--to", "web", "-o", &to, "--run", &with]));
        Bundle::read(&std::fs::read(&out).unwrap()).unwrap()
    };
    let names = |bundle: &Bundle| -> Vec<(String, bool)> {
        bundle.views.iter().map(|v| (v.name.clone(), v.reference.is_some())).collect()
    };
    let expected = |there: bool| [("glance".to_string(), there), ("back".to_string(), false)];
    // The pictures of a check show bands as they are, and this scene's pictures show them as colours.
    assert_eq!(names(&exported("data/scenes/glossy-sky.toml")), expected(false));
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/");
    let text = std::fs::read_to_string("data/scenes/glossy-sky.toml").unwrap();
    let text =
        text.replace("channels = \"bands\"\n", "").replace("../../", root).replace("../", &format!("{root}data/"));
    let plain = folder.path().join("plain.toml").display().to_string();
    std::fs::write(&plain, text).unwrap();
    let words = ["export", &plain, "--to", "web", "-o", &to, "--run", &with];
    let bundle = exported(&plain);
    assert_eq!(names(&bundle), expected(true));
    assert_eq!(bundle.views[0].reference, Some(std::fs::read(&drawn).unwrap()));

    // The slabs are those of the fit. Computed again without an edit, they say what the scene says already.
    let [slabs] = bundle.leaves.as_slice() else { panic!("one leaf") };
    let fit = LeafFit::open("fits/balata".as_ref()).unwrap();
    assert_eq!(slabs.thickness_mm, fit.thickness(fit.lead()).unwrap());
    let leaf = bundle.scene.leaf(slabs.material).unwrap();
    let mut again = leaf.clone();
    slabs.apply(&mut again).unwrap();
    for (side, maps) in leaf.sides.iter() {
        let (Interior::Scalars(before), Interior::Scalars(after)) = (&maps.interior, &again.sides[side].interior)
        else {
            panic!("curves")
        };
        for texel in maps.gamma_delta.iter().step_by(997) {
            let h = slabs.thickness_mm as f32 + texel[3];
            for (a, b) in at(before, h).into_iter().zip(at(after, h)) {
                assert!((a / b - 1.0).abs() < 3e-4, "{side}, {h} mm: {a} and {b}");
            }
        }
    }

    // A picture of another size is not that scene's reference.
    image::RgbaImage::new(80, 60).save(&drawn).unwrap();
    let refused = run(words);
    assert_eq!(refused.status.code(), Some(2));
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(said.contains("glance-reference.png") && said.contains("80x60") && said.contains("800x600"), "{said}");
}

#[test]
fn a_fit_for_the_browser_is_wholly_in_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let [to, with] = ["leaf.mesophyll", "run"].map(|n| folder.path().join(n).display().to_string());
    succeeded(&run(["export", "fits/elm", "--to", "web", "-o", &to, "--run", &with]));
    let bundle = Bundle::read(&std::fs::read(&to).unwrap()).unwrap();
    assert_eq!((bundle.title.as_str(), bundle.views.len(), bundle.leaves.len()), ("elm", 2, 1));
    for view in &bundle.views {
        let camera = view.camera;
        let towards = (camera.target - camera.eye).normalize();
        // The ground under the leaf reaches beyond the pictures.
        let leaves = |instance: &&Instance| bundle.scene.leaf(instance.material).is_some();
        for instance in bundle.scene.instances.iter().filter(leaves) {
            for p in &bundle.scene.meshes[instance.mesh].positions {
                let seen = instance.transform.transform_point3(*p) - camera.eye;
                let angle = seen.angle_between(towards).to_degrees();
                assert!(angle <= 0.501 * camera.fov_y_deg, "{}: {p} is {angle}° from the middle", view.name);
            }
        }
    }
}
