//! Texels without a measurement take the value of the nearest good one, so that interpolation at the leaf's edge and
//! around defects stays on the leaf. Filled values are not measurements: the mask says so.

use crate::leaf_folder::{Error, Result};
use mesophyll_base::image::ImageSize;
use std::collections::VecDeque;
use std::path::Path;

/// For each texel, the index of (one of) its nearest good texels by 4-connected distance; a good texel gets its own
/// index. `None` when there is no good texel at all.
pub fn sources(good: &[bool], width: usize, height: usize) -> Option<Vec<u32>> {
    let mut source: Vec<u32> = vec![u32::MAX; good.len()];
    let mut queue: VecDeque<u32> = VecDeque::new();
    for (k, &g) in good.iter().enumerate() {
        if g {
            source[k] = k as u32;
            queue.push_back(k as u32);
        }
    }
    if queue.is_empty() {
        return None;
    }
    while let Some(at) = queue.pop_front() {
        let k = at as usize;
        for next in ImageSize::new(width, height).neighbours(k) {
            if source[next] == u32::MAX {
                source[next] = source[k];
                queue.push_back(next as u32);
            }
        }
    }
    Some(source)
}

/// Gives every texel that is not `good` the value of its nearest good one, in all planes from the same texel. Planes
/// are not changed where no texel is good.
pub fn nearest<T: Copy>(planes: &mut [Vec<T>], good: &[bool], width: usize, height: usize) {
    if let Some(source) = sources(good, width, height) {
        for plane in planes {
            for k in 0..plane.len() {
                plane[k] = plane[source[k] as usize];
            }
        }
    }
}

/// As [`nearest`].
///
/// # Errors
/// [`Error::Input`] naming `path`, where no texel is good.
pub fn require<T: Copy>(path: &Path, planes: &mut [Vec<T>], good: &[bool], width: usize, height: usize) -> Result<()> {
    if !good.contains(&true) {
        return Err(Error::input(path, "no good texel at all"));
    }
    nearest(planes, good, width, height);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filling_keeps_good_texels_and_leaves_no_hole() {
        let (w, h) = (7, 5);
        let good: Vec<bool> = (0..w * h).map(|k| k == 8 || k == 9).collect();
        let mut planes = [(0..w * h).map(|k| if good[k] { k as f32 } else { f32::NAN }).collect::<Vec<_>>()];
        require(Path::new("a.exr"), &mut planes, &good, w, h).unwrap();
        assert_eq!((planes[0][8], planes[0][9]), (8.0, 9.0));
        assert_eq!((planes[0][7], planes[0][10], planes[0][1]), (8.0, 9.0, 8.0));
        assert!(planes[0].iter().all(|v| *v == 8.0 || *v == 9.0));
        assert!(require(Path::new("a.exr"), &mut planes, &vec![false; w * h], w, h).is_err());
    }
}
