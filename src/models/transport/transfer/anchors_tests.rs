use super::*;
use crate::test_worlds::{leaf, square};

fn sheet(size: f64) -> ReferenceLeaf {
    leaf(square(0.5 * size), [0.3, 0.3], 0.2, None)
}

/// The weights of every level sum to one. An even light stays even, a light that rises evenly along the leaf keeps
/// its mean, and the last level is that mean.
#[test]
fn a_chain_keeps_what_is_even() {
    for grid in [[5, 3], [18, 15], [1, 1], [2, 7]] {
        let count = levels(grid);
        assert_eq!(level(grid, count - 1), [1, 1]);
        assert!(count == 1 || level(grid, count - 2) != [1, 1]);
        for to in 0..count {
            let nodes = coarser(grid, to);
            assert_eq!(nodes.len(), level(grid, to).iter().product::<usize>());
            for of in &nodes {
                assert!((of.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-12);
            }
            let rising = |of: &Vec<(usize, f64)>| of.iter().map(|(k, w)| w * (k % grid[0]) as f64).sum::<f64>();
            let mean = nodes.iter().map(rising).sum::<f64>() / nodes.len() as f64;
            assert!((mean - 0.5 * (grid[0] - 1) as f64).abs() < 1e-9, "{grid:?} {to} {mean}");
        }
    }
}

/// A square with three by three anchors has them at its corners, at the middles of its edges and at its centre. Its
/// vertices lie at the grid's ends.
#[test]
fn a_grid_covers_its_piece() {
    let leaf = sheet(10.0);
    let found = MeshAnchors::on_leaf(&leaf, [3, 3]);
    assert_eq!(found.points.len(), 9);
    let middle = position(&leaf, &found.points[4].points[0]);
    assert!(middle.length() < 1e-6, "{middle}");
    for anchor in &found.points {
        let p = position(&leaf, &anchor.points[0]);
        assert!([-5.0, 0.0, 5.0].iter().any(|x| (p.x - x).abs() < 1e-6), "{p}");
    }
    for place in &found.places {
        assert!([0.0, 2.0].contains(&place[1]) && [0.0, 2.0].contains(&place[2]), "{place:?}");
    }
}

/// Two sheets that share one corner are two pieces. Two triangles whose edges share only their places are one
/// piece.
#[test]
fn leaves_that_touch_are_not_joined() {
    let mut leaf = sheet(10.0);
    let more: Vec<DVec3> = leaf.mesh.positions.iter().map(|p| *p + DVec3::new(10.0, 10.0, 0.0)).collect();
    let count = leaf.mesh.positions.len() as u32;
    leaf.mesh.positions.extend(more);
    let indices: Vec<u32> = leaf.mesh.indices.iter().map(|i| i + count).collect();
    leaf.mesh.indices.extend(indices);
    leaf.mesh.normals.extend(leaf.mesh.normals.clone());
    leaf.mesh.uvs.extend(leaf.mesh.uvs.clone());
    assert_eq!(pieces(&leaf).len(), 2);
    // Every triangle gets vertices of its own.
    let mut split = leaf.clone();
    split.mesh.positions = leaf.mesh.indices.iter().map(|i| leaf.mesh.positions[*i as usize]).collect();
    split.mesh.indices = (0..leaf.mesh.indices.len() as u32).collect();
    assert_eq!(pieces(&split).len(), 2);
    assert_eq!(MeshAnchors::on_leaf(&leaf, [2, 1]).points.len(), 4);
}

/// Anchors stand where the mask leaves the leaf, also where it cuts the grid's node away.
#[test]
fn anchors_stand_on_the_leaf() {
    let mut leaf = sheet(10.0);
    (leaf.width, leaf.height) = (8, 8);
    // Only the left half is a leaf.
    leaf.mask = Some((0..64).map(|k| u8::from(k % 8 < 4)).collect());
    for anchor in &MeshAnchors::on_leaf(&leaf, [4, 4]).points {
        assert!(anchor.points.iter().all(|p| on_leaf(&leaf, p)), "{anchor:?}");
    }
    // A neighbourhood in the middle of a leaf is complete, and its mean is the anchor.
    let whole = &MeshAnchors::on_leaf(&sheet(10.0), [5, 5]).points[12];
    let mean = whole.points.iter().map(|p| position(&leaf, p)).sum::<DVec3>() / whole.points.len() as f64;
    assert!(whole.points.len() == POINTS && mean.length() < 0.15, "{mean}");
}
