//! What a window shows behind a scene that has nothing there: a dim wall, darker towards the floor, in place of black.

use mesophyll_viewer::scene as viewer;
use std::f32::consts::PI;
use std::sync::Arc;

/// Rows of the picture, which changes only with height.
const ROWS: u32 = 64;
/// What is shown at the floor, at the horizon and overhead: exposed radiance, before the curve.
const LEVELS: [[f32; 3]; 3] = [[0.045, 0.045, 0.047], [0.20, 0.21, 0.22], [0.10, 0.11, 0.12]];

/// The backdrop of a scene without a sky that is seen, a background or a backdrop; `None` for any other scene. It
/// lights nothing.
pub fn behind(scene: &viewer::Scene) -> Option<viewer::Backdrop> {
    let black = scene.background == [0.0; 3] && scene.exposure > 0.0;
    if !black || scene.dome.is_some() || scene.backdrop.is_some() {
        return None;
    }
    let row = |j: u32| {
        let up = (PI * (j as f32 + 0.5) / ROWS as f32).cos();
        let end = LEVELS[if up < 0.0 { 0 } else { 2 }];
        let share = up.abs().sqrt();
        let colour: [f32; 3] = std::array::from_fn(|c| LEVELS[1][c] + share * (end[c] - LEVELS[1][c]));
        [colour.map(|v| v / scene.exposure); 2 * ROWS as usize]
    };
    let texels = Arc::new((0..ROWS).flat_map(row).collect());
    Some(viewer::Backdrop { width: 2 * ROWS, height: ROWS, texels, turn: 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Overhead first and the floor last, whatever the exposure is; and only where there is nothing else.
    #[test]
    fn only_what_would_be_black_gets_a_wall() {
        let scene = viewer::Scene { exposure: 0.1, ..viewer::Scene::default() };
        let wall = behind(&scene).expect("a wall");
        assert_eq!(wall.texels.len(), (wall.width * wall.height) as usize);
        let shown = |row: u32| 0.1 * wall.texels[(row * wall.width) as usize][1];
        assert!((shown(0) - LEVELS[2][1]).abs() < 0.01 && (shown(ROWS - 1) - LEVELS[0][1]).abs() < 0.01);
        assert!(shown(ROWS / 2) > 0.15 && wall.texels.iter().flatten().all(|v| *v > 0.0));
        for other in [
            viewer::Scene { background: [0.1; 3], ..scene.clone() },
            viewer::Scene { backdrop: Some(wall), ..scene.clone() },
            viewer::Scene { exposure: 0.0, ..scene },
        ] {
            assert!(behind(&other).is_none());
        }
    }
}
