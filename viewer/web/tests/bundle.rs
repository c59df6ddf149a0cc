//! What is written is read back, and what is not a scene is refused in one sentence.

use glam::{Quat, Vec2, Vec3, Vec4};
use mesophyll_optics::slab::response;
use mesophyll_viewer::scene::{
    Camera, Interior, LeafMaterial, Lobe, Material, Mesh, Scene, SectionAnimation, SectionBinding, SectionMotion,
    SideMaps, Sides, WindState,
};
use mesophyll_web::bundle::{Bundle, BundleView, Error, LeafSlabs, SideSlab, StillSections, slab, slab_curve};
use std::sync::Arc;

const SLAB: SideSlab = SideSlab { sigma_a: [0.9, 0.5, 1.6], sigma_s: [11.0, 12.0, 10.0] };
/// δ of the two texels (mm).
const DELTAS: [f32; 2] = [-0.03, 0.05];

fn leaf() -> LeafMaterial {
    let texels: Vec<[f32; 4]> = DELTAS.iter().map(|d| [1.0, 0.9, 0.8, *d]).collect();
    let side = || SideMaps {
        gamma_delta: texels.clone(),
        gloss: Some(vec![[0.04, 0.04, 0.04, 0.3]; 2]),
        normal: Some(vec![[0.1, 0.0, 0.995]; 2]),
        translucency: None,
        interior: Interior::Scalars(slab_curve(&slab(SLAB.sigma_a, SLAB.sigma_s, 0.2, &texels))),
    };
    LeafMaterial {
        name: "two texels".into(),
        width: 2,
        height: 1,
        thickness_mm: 0.2,
        lobe: Lobe::CookTorrance { index: 1.45 },
        sides: Sides { front: side(), back: SideMaps::black() },
        mask: Some(vec![1, 0]),
    }
}

fn bundle() -> Bundle {
    let mesh = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 3],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    };
    let mut scene = Scene { exposure: 1.5, msaa: 4, wind: Some(WindState { time_s: 2.5 }), ..Scene::default() };
    let mut one = scene.add(mesh, Material::Leaf(leaf()));
    one.carried = Some(SectionBinding { first: 0, vertices: None });
    scene.instances.push(one);
    let at = |time: f64| {
        let to = Vec3::new(time as f32, 0.0, 0.0);
        vec![SectionMotion { from: Vec3::ZERO, to, turn: Quat::from_rotation_z(0.3) }]
    };
    let of_vertices = Arc::new(vec![0, 0, 0]);
    scene.sections =
        Some(SectionAnimation { count: 1, of_vertices, turn_normals: true, poses: None, at: Arc::new(at) });
    let camera = Camera { eye: Vec3::new(0.0, -5.0, 5.0), target: Vec3::ZERO, up: Vec3::Z, fov_y_deg: 30.0 };
    Bundle {
        title: "σ and ρ".into(),
        program: "a test".into(),
        still: StillSections::of(&scene),
        scene,
        views: vec![BundleView { name: "front".into(), camera, size: [80, 60], reference: Some(vec![1, 2, 3]) }],
        leaves: vec![LeafSlabs { material: 0, thickness_mm: 0.2, sides: Sides { front: Some(SLAB), back: None } }],
    }
}

#[test]
fn what_is_written_is_read_back() {
    let written = bundle();
    let bytes = written.write().unwrap();
    assert_eq!(bytes, bundle().write().unwrap(), "the same bundle gives the same bytes");
    let read = Bundle::read(&bytes).unwrap();
    // The functions of sections cannot be compared; `Debug` shows everything else, and every digit of it.
    assert_eq!(format!("{written:?}"), format!("{read:?}"));
    let sections = read.scene.sections.expect("sections");
    let at_time = (written.scene.sections.unwrap().at)(2.5);
    for time in [0.0, 2.5, 9.0] {
        assert_eq!((sections.at)(time), at_time, "plants stand as at the time of the wind");
    }
}

#[test]
fn other_bytes_are_refused() {
    let good = bundle().write().unwrap();
    assert!(matches!(Bundle::read(b""), Err(Error::Kind)));
    assert!(matches!(Bundle::read(b"\x89PNG\r\n\x1a\n and more"), Err(Error::Kind)));
    let mut later = good.clone();
    later[8] = 3;
    let said = Bundle::read(&later).unwrap_err().to_string();
    assert_eq!(said, "found version 3 of the format, expected version 2; export the scene again");
    for end in (12..good.len()).step_by(7) {
        assert!(matches!(Bundle::read(&good[..end]), Err(Error::Damaged(_))), "cut after {end} bytes");
    }
    let mut no_leaf = bundle();
    no_leaf.leaves[0].material = 3;
    let said = Bundle::read(&no_leaf.write().unwrap()).unwrap_err().to_string();
    assert_eq!(said, "the contents are damaged: slabs of material 3, which is no leaf");
    let no_view = Bundle { views: Vec::new(), ..bundle() };
    let said = Bundle::read(&no_view.write().unwrap()).unwrap_err().to_string();
    assert_eq!(said, "the contents are damaged: it has no view");
}

#[test]
fn an_edit_says_what_the_slab_says() {
    let mut edited = leaf();
    let back = format!("{:?}", edited.sides.back);
    let new = SideSlab { sigma_a: [0.3, 2.5, 0.0], sigma_s: [20.0, 6.0, 9.0] };
    let slabs = LeafSlabs { material: 0, thickness_mm: 0.31, sides: Sides { front: Some(new), back: None } };
    slabs.apply(&mut edited).unwrap();
    assert_eq!(edited.thickness_mm, 0.31);
    assert_eq!(format!("{:?}", edited.sides.back), back, "a side without a slab stays");
    let Interior::Scalars(curve) = &edited.sides.front.interior else { panic!("a curve") };
    for delta in DELTAS {
        // What the shader computes: linear interpolation in single precision.
        let h = 0.31 + f64::from(delta);
        let x = (h - f64::from(curve.min_mm)) / f64::from(curve.max_mm - curve.min_mm);
        assert!((-1e-6..=1.0 + 1e-6).contains(&x), "the curve reaches {h} mm");
        let place = x.clamp(0.0, 1.0) * (curve.rho_d.len() - 1) as f64;
        let k = (place as usize).min(curve.rho_d.len() - 2);
        for c in 0..3 {
            let mix =
                |list: &[[f32; 3]]| f64::from(list[k][c]) + (place - k as f64) * f64::from(list[k + 1][c] - list[k][c]);
            let r = response(new.sigma_a[c], new.sigma_s[c], h);
            assert!((mix(&curve.rho_d) / r.rho_d - 1.0).abs() < 2e-4, "ρd, channel {c}, {h} mm");
            assert!((mix(&curve.rho_t) / r.rho_t - 1.0).abs() < 2e-4, "ρt, channel {c}, {h} mm");
        }
    }
    let before = format!("{edited:?}");
    for (thickness_mm, sigma) in [(0.0, 1.0), (f64::NAN, 1.0), (0.2, -1.0), (0.2, f64::INFINITY)] {
        let front = Some(SideSlab { sigma_a: [sigma; 3], ..new });
        let bad = LeafSlabs { thickness_mm, sides: Sides { front, back: None }, ..slabs.clone() };
        assert!(bad.apply(&mut edited).is_err());
        assert_eq!(format!("{edited:?}"), before, "a refused edit changes nothing");
    }
}
