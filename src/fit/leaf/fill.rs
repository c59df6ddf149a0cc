//! Texels without a measurement take the value of the nearest good one, so that interpolation at the leaf's edge and
//! around defects stays on the leaf. Filled values are not measurements: the mask says so.

use mesophyll_capture::grid::neighbours;
use std::collections::VecDeque;

/// For each texel the index of (one of) its nearest good texels by 4-connected distance, itself where it is good;
/// `None` when there is no good texel at all.
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
        for next in neighbours(k, width, height) {
            if source[next] == u32::MAX {
                source[next] = source[k];
                queue.push_back(next as u32);
            }
        }
    }
    Some(source)
}

/// Fills `values` where `good` is false.
pub fn nearest<T: Copy>(values: &mut [T], good: &[bool], width: usize, height: usize) {
    if let Some(source) = sources(good, width, height) {
        for k in 0..values.len() {
            values[k] = values[source[k] as usize];
        }
    }
}
