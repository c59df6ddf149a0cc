//! Copies that show the light of one of them.
//!
//! A lawn consists of the same square a thousand times over. In its middle every square has the same neighbours, and so
//! nearly the same light. One copy has anchors then, and the others point to them. All copies of a list are turned and
//! scaled alike, so that vectors and harmonics hold for each of them.

use crate::manifest::SceneManifest;
use glam::DVec3;
use std::collections::BTreeMap;

/// For each instance of the manifest, the one whose light it shows: itself, or that of the copies of its list which
/// stands nearest to the middle of them all. Empty where the scene does not ask for it.
pub fn sources(manifest: &SceneManifest) -> Vec<usize> {
    if !manifest.transfer.as_ref().is_some_and(|t| t.shared) {
        return Vec::new();
    }
    let mut lists: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (k, instance) in manifest.instances.iter().enumerate() {
        if let Some(list) = instance.list {
            lists.entry(list).or_default().push(k);
        }
    }
    let mut out: Vec<usize> = (0..manifest.instances.len()).collect();
    for copies in lists.values() {
        let at = |k: usize| DVec3::from(manifest.instances[k].position_mm);
        let middle = copies.iter().map(|k| at(*k)).sum::<DVec3>() / copies.len() as f64;
        let nearest = copies.iter().min_by(|a, b| at(**a).distance(middle).total_cmp(&at(**b).distance(middle)));
        copies.iter().for_each(|k| out[*k] = *nearest.unwrap_or(k));
    }
    out
}

/// The place that has the anchors for a place of `seen`: its source, or itself beyond the end of the list.
pub fn source(sources: &[usize], k: usize) -> usize {
    sources.get(k).copied().unwrap_or(k)
}

/// Whether each place has anchors of its own: a source does if any of the places that show its light is seen.
pub fn with_anchors(seen: &[bool], sources: &[usize]) -> Vec<bool> {
    let mut out = vec![false; seen.len()];
    (0..seen.len()).filter(|k| seen[*k]).for_each(|k| out[source(sources, k)] = true);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each list has its own middle, and an instance without a list its own light.
    #[test]
    fn the_copy_in_the_middle_stands_for_its_list() {
        let text = |shared: bool| {
            let at = |leaf: &str, x: f64| format!("[[instance]]\nleaf = \"{leaf}\"\nposition_mm = [{x}, 0, 0]\n");
            let all: String = [("a", 0.0), ("a", 9.0), ("b", 1.0), ("a", 4.0), ("b", 8.0), ("b", 6.0), ("b", 5.0)]
                .map(|(leaf, x)| at(leaf, x))
                .concat();
            let mut out: SceneManifest =
                toml::from_str(&format!("schema = 1\nname = \"s\"\n[transfer]\nshared = {shared}\n{all}")).unwrap();
            let lists = [Some(0), Some(0), Some(1), Some(0), Some(1), None, Some(1)];
            out.instances.iter_mut().zip(lists).for_each(|(i, list)| i.list = list);
            out
        };
        assert!(sources(&text(false)).is_empty());
        let found = sources(&text(true));
        assert_eq!(found, [3, 3, 6, 3, 6, 5, 6]);
        // Of the first list a single copy is seen, and of the second none.
        let seen = [true, false, false, false, false, true, false, true];
        assert_eq!(with_anchors(&seen, &found), [false, false, false, true, false, true, false, true]);
        assert_eq!(with_anchors(&seen, &[]), seen);
    }
}
