//! Branches that the adapter poses: sections where pieces of an axis meet, sections between, and what grows on them.

use crate::common::*;
use glam::{Mat4, Quat, Vec3};
use mesophyll_viewer::Options;
use mesophyll_viewer::scene::{
    AxisPiece, Camera, Instance, PoseHierarchy, PoseLimb, Scene, SectionAnimation, SectionBinding, SectionMotion,
    SectionSeat, WindState,
};
use std::sync::Arc;

const LENGTH: f32 = 20.0;
/// Where the pieces of the branch begin, and their directions.
const PIECES: [(f32, Vec3); 3] = [(0.0, Vec3::X), (0.3, Vec3::new(0.8, 0.6, 0.0)), (0.65, Vec3::new(0.6, 0.0, 0.8))];
/// Shares with a section: where pieces begin and at the tip, and as good as there, before and behind.
const SHARES: [f32; 10] = [0.0, 1e-5, 0.29999, 0.3, 0.30001, 0.64999, 0.65, 0.65001, 0.99999, 1.0];
/// Numbers of sections that are as good as at one place.
const BESIDE: [[usize; 2]; 6] = [[0, 1], [3, 2], [3, 4], [6, 5], [6, 7], [9, 8]];
/// Where a straight branch grows, as long as the first.
const JOINT: f32 = 0.5;

/// The place at a share of the axis at rest, and its piece.
fn at(share: f32) -> (Vec3, u32) {
    let piece = PIECES.iter().rposition(|(begin, _)| *begin <= share).unwrap_or(0);
    let mut place = Vec3::ZERO;
    for k in 0..piece {
        place += LENGTH * (PIECES[k + 1].0 - PIECES[k].0) * PIECES[k].1;
    }
    (place + LENGTH * (share - PIECES[piece].0) * PIECES[piece].1, piece as u32)
}

/// A small leaf on each of these sections, then one where the second branch grows, one on its root and one on its tip.
/// With `hangs`, each leaf hangs beside the axis and turns by itself.
fn scene(hangs: bool, closed_form: bool) -> Scene {
    let mut scene = scene_of(uniform_leaf());
    let limb = |root, along, parent, at, pieces| PoseLimb {
        root,
        axes: [along, Vec3::Z],
        length: LENGTH,
        taper: [0.5, 0.5f32.ln(), 2.0 * 2f32.ln()],
        coefficients: [0.5, -0.1, 0.02, 0.01],
        parent,
        at,
        offset: Vec3::ZERO,
        pieces,
    };
    let (joint, below) = at(JOINT);
    let begin = |k: usize| at(PIECES[k].0).0;
    let mut pieces: Vec<AxisPiece> =
        (0..3).map(|k| AxisPiece { begin: PIECES[k].0, place: begin(k), way: PIECES[k].1 }).collect();
    pieces.push(AxisPiece { begin: 0.0, place: Vec3::ZERO, way: Vec3::Y });
    let offset = if hangs { Vec3::new(0.0, 0.5, 1.0) } else { Vec3::ZERO };
    let seat = |limb, share, (on, piece): (Vec3, u32)| SectionSeat {
        limb,
        share,
        piece,
        from: on + offset,
        offset,
        axis: Vec3::X,
    };
    let mut seats: Vec<SectionSeat> = SHARES.iter().chain([&JOINT]).map(|share| seat(0, *share, at(*share))).collect();
    seats.push(seat(1, 0.0, (joint, 0)));
    seats.push(seat(1, 1.0, (joint + LENGTH * Vec3::Y, 0)));
    let points: Vec<Vec3> = seats.iter().map(|s| s.from).collect();
    scene.instances = (0..seats.len())
        .map(|k| Instance {
            transform: Mat4::from_scale_rotation_translation(Vec3::splat(0.05), Quat::IDENTITY, points[k]),
            carried: Some(SectionBinding { first: k as u32, vertices: None }),
            ..scene.instances[0]
        })
        .collect();
    let count = points.len();
    let poses = PoseHierarchy {
        limbs: vec![
            limb(Vec3::ZERO, Vec3::X, None, (0.0, 0), [0, 3]),
            limb(joint, Vec3::Y, Some(0), (JOINT, below), [3, 1]),
        ],
        pieces,
        seats,
        closed_form,
        amplitudes: Arc::new(|time| vec![[0.3 * time as f32, 0.4 * time as f32]; 2]),
        turns: hangs.then(|| Arc::new(move |time: f64| vec![0.2 * time as f32; count]) as _),
    };
    scene.sections = Some(SectionAnimation {
        count,
        of_vertices: Arc::new(Vec::new()),
        turn_normals: true,
        poses: Some(Arc::new(poses)),
        at: Arc::new(move |_| {
            points.iter().map(|p| SectionMotion { from: *p, to: *p, turn: Quat::IDENTITY }).collect()
        }),
    });
    scene.wind = Some(WindState { time_s: 0.0 });
    scene
}

/// What a branch does: whether sections hang beside it, whether its lengths are corrected in closed form, and whether a
/// group of invocations poses it.
const WAYS: [[bool; 3]; 6] = [
    [false, false, false],
    [true, false, false],
    [false, true, false],
    [false, false, true],
    [true, false, true],
    [false, true, true],
];

/// Where the vertices of each leaf of a scene are, at rest and at a time.
fn places(scene: &Scene, time_s: f64, groups: bool) -> Option<Vec<Vec<[Vec3; 2]>>> {
    let mut renderer = renderer_with(&Options { groups: Some(groups), ..Options::default() })?;
    renderer.set_scene(scene).expect("scene");
    renderer.set_time(&WindState { time_s });
    let of = |k: usize| {
        let (rest, now) = (&scene.instances[k], renderer.bent_vertices(scene, k).expect("vertices"));
        let mesh = &scene.meshes[rest.mesh].positions;
        let both: Vec<[Vec3; 2]> =
            mesh.iter().zip(now).map(|(p, [q, ..])| [rest.transform.transform_point3(*p), q]).collect();
        assert!(!both.is_empty() && both.iter().all(|[_, now]| now.is_finite()), "leaf {k}: {both:?}");
        both
    };
    Some((0..scene.instances.len()).map(of).collect())
}

#[test]
fn a_calm_moves_nothing() {
    for [hangs, closed_form, groups] in WAYS {
        let Some(leaves) = places(&scene(hangs, closed_form), 0.0, groups) else { return };
        for (k, leaf) in leaves.iter().enumerate() {
            leaf.iter().for_each(|[rest, now]| assert!(rest.distance(*now) < 1e-5, "leaf {k}: {rest} {now}"));
        }
    }
}

#[test]
fn sections_where_pieces_meet_are_those_beside_them() {
    for [hangs, closed_form, groups] in WAYS {
        let Some(leaves) = places(&scene(hangs, closed_form), 2.0, groups) else { return };
        let moved = |k: usize| leaves[k].iter().map(|[rest, now]| *now - *rest).collect::<Vec<Vec3>>();
        let apart = |a: usize, b: usize| moved(a).iter().zip(moved(b)).map(|(a, b)| a.distance(b)).fold(0.0, f32::max);
        let tip = moved(9)[0].length();
        assert!(tip > 0.1 * LENGTH, "the tip moves by {tip}");
        for [at, beside] in BESIDE {
            let off = apart(at, beside);
            assert!(off < 2e-4 * LENGTH, "{} and {}: {off}", SHARES[at], SHARES[beside]);
        }
        // What grows on a branch moves as the branch does there.
        let (joint, root) = (SHARES.len(), SHARES.len() + 1);
        assert!(apart(joint, root) < 2e-5 * LENGTH, "{}", apart(joint, root));
        // Its own tip bends besides.
        assert!(apart(root, root + 1) > 0.05 * LENGTH, "{}", apart(root, root + 1));
    }
}

/// A straight branch of so many pieces, with a leaf at each of so many shares, most of them on no mark, and on its tip
/// branches on branches, with a leaf on the last one's tip.
fn long(pieces: u32, leaves: u32, above: u32) -> Scene {
    let mut scene = scene(false, false);
    let sections = scene.sections.as_mut().expect("sections");
    let first = sections.poses.as_ref().expect("poses").limbs[0];
    let share = |k: u32| k as f32 / pieces as f32;
    let along = |share: f32| share * LENGTH * Vec3::X;
    let mut of_pieces: Vec<AxisPiece> =
        (0..pieces).map(|k| AxisPiece { begin: share(k), place: along(share(k)), way: Vec3::X }).collect();
    let mut limbs = vec![PoseLimb { pieces: [0, pieces], ..first }];
    for k in 0..above {
        of_pieces.push(AxisPiece { begin: 0.0, place: Vec3::ZERO, way: Vec3::X });
        let (root, on) = (along(1.0 + k as f32), if k == 0 { pieces - 1 } else { 0 });
        limbs.push(PoseLimb { root, parent: Some(k), at: (1.0, on), pieces: [pieces + k, 1], ..first });
    }
    let seat =
        |limb, share: f32, piece, from| SectionSeat { limb, share, piece, from, offset: Vec3::ZERO, axis: Vec3::X };
    let at = |k: u32| k as f32 / (leaves - 1) as f32;
    let piece = |x: f32| ((x * pieces as f32) as u32).min(pieces - 1);
    let mut seats: Vec<SectionSeat> = (0..leaves).map(|k| seat(0, at(k), piece(at(k)), along(at(k)))).collect();
    seats.push(seat(above, 1.0, if above == 0 { pieces - 1 } else { 0 }, along(1.0 + above as f32)));
    let count = limbs.len();
    let amplitudes = Arc::new(move |time| vec![[0.3 * time as f32, 0.4 * time as f32]; count]);
    let poses = PoseHierarchy { limbs, pieces: of_pieces, seats, closed_form: false, amplitudes, turns: None };
    let points: Vec<Vec3> = poses.seats.iter().map(|s| s.from).collect();
    let leaf = scene.instances[0];
    let carried = |first| Some(SectionBinding { first, vertices: None });
    let hung = |(k, at): (usize, &Vec3)| {
        let transform = Mat4::from_scale_rotation_translation(Vec3::splat(0.05), Quat::IDENTITY, *at);
        Instance { transform, carried: carried(k as u32), ..leaf }
    };
    scene.instances = points.iter().enumerate().map(hung).collect();
    (sections.count, sections.poses) = (points.len(), Some(Arc::new(poses)));
    sections.at =
        Arc::new(move |_| points.iter().map(|p| SectionMotion { from: *p, to: *p, turn: Quat::IDENTITY }).collect());
    scene
}

/// Groups pose as single invocations do, also where a branch has more marks and more sections than a group has
/// invocations, and where it has more ancestors.
#[test]
fn groups_of_invocations_pose_as_single_ones_do() {
    for (pieces, leaves, above) in [(1, 5, 0), (31, 40, 1), (32, 40, 2), (33, 90, 3), (100, 17, 31), (5, 5, 40)] {
        let scene = long(pieces, leaves, above);
        let mut boxes = Vec::new();
        let mut both = Vec::new();
        for groups in [false, true] {
            let Some(found) = places(&scene, 0.5, groups) else { return };
            both.push(found.concat());
            let Some(mut renderer) = renderer_with(&Options { groups: Some(groups), ..Options::default() }) else {
                return;
            };
            renderer.set_scene(&scene).expect("scene");
            renderer.set_time(&WindState { time_s: 0.5 });
            boxes.push(renderer.moving_boxes().expect("boxes"));
        }
        let far = |[rest, now]: &[Vec3; 2]| rest.distance(*now);
        let moved = both[0].iter().map(far).fold(0.0, f32::max);
        let off = both[0].iter().zip(&both[1]).map(|([_, a], [_, b])| a.distance(*b)).fold(0.0, f32::max);
        let long = (1 + above) as f32 * LENGTH;
        assert!(moved > 0.05 * LENGTH && off < 2e-6 * long, "{pieces} pieces: moved by {moved}, off by {off}");
        assert_eq!(boxes[0].len(), boxes[1].len());
        for (a, b) in boxes[0].iter().zip(&boxes[1]) {
            let apart = |a: &[Vec3; 2], b: &[Vec3; 2]| a[0].distance(b[0]).max(a[1].distance(b[1]));
            assert!(a.zip(*b).map_or(a == b, |(a, b)| apart(&a, &b) < 2e-6 * long), "{a:?} {b:?}");
        }
    }
}

/// The same, but what hung on this section alone stands in the scene, as bark with a section for each vertex.
fn bark_on(section: usize, closed_form: bool) -> Scene {
    let mut scene = scene(false, closed_form);
    let bark = scene.instances.swap_remove(section);
    let vertices = scene.meshes[bark.mesh].positions.len();
    scene.sections.as_mut().expect("sections").of_vertices = Arc::new(vec![0; vertices]);
    scene.instances =
        vec![Instance { carried: Some(SectionBinding { first: section as u32, vertices: Some(0) }), ..bark }];
    scene
}

/// Bark is only left out where it never comes: not where a bent branch is seen and its place at rest is not. The tip of
/// the second branch reaches as far as both branches together.
#[test]
fn bark_is_drawn_wherever_it_may_come() {
    let Some(mut renderer) = renderer() else { return };
    let towards = |target: Vec3, eye: Vec3| Camera { eye, target, up: Vec3::Z, fov_y_deg: 20.0 };
    for (section, reach) in [(9, LENGTH), (12, (1.0 + JOINT) * LENGTH)] {
        let scene = bark_on(section, false);
        renderer.set_scene(&scene).expect("scene");
        renderer.set_time(&WindState { time_s: 2.0 });
        let bent: Vec<Vec3> = renderer.bent_vertices(&scene, 0).expect("vertices").iter().map(|[p, ..]| *p).collect();
        let middle = bent.iter().sum::<Vec3>() / bent.len() as f32;
        let at_rest = scene.instances[0].transform.w_axis.truncate();
        let far = middle.distance(at_rest);
        assert!(far > 0.1 * LENGTH && middle.length() < reach, "{section}: {at_rest} {middle}");
        // The picture of its place now does not hold its place at rest.
        let across = (at_rest - middle).any_orthonormal_vector();
        let eye = middle - 0.5 * far * across;
        let mut seen = |camera: Camera| {
            let picture = renderer.render(&camera, 64, 64).expect("picture");
            (renderer.stats().triangles > 0, picture.hdr.iter().any(|p| p[3] > 0.0))
        };
        assert_eq!(seen(towards(middle, eye)), (true, true), "{section}");
        // From just beyond what it reaches, and from just within, looking away: nothing is seen, but it might come.
        let away = |distance: f32| towards(-Vec3::Y * 2.0 * distance, -Vec3::Y * distance);
        assert_eq!(seen(away(reach + 0.1 * LENGTH)), (false, false), "{section}");
        assert_eq!(seen(away(0.99 * reach)), (true, false), "{section}");
    }
    // Lengths in closed form may grow. So nothing is left out.
    renderer.set_scene(&bark_on(9, true)).expect("scene");
    renderer.render(&towards(-4.0 * LENGTH * Vec3::Y, -2.0 * LENGTH * Vec3::Y), 64, 64).expect("picture");
    assert!(renderer.stats().triangles > 0);
}
