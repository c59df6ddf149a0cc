//! What was really created, uploaded and drawn, counted where it happens, so that "left out" can be proved.

/// One upload to the adapter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Upload {
    /// For instance `leaf 0 front gloss`.
    pub name: String,
    /// As they lie in the adapter's memory.
    pub bytes: u64,
}

/// Counts since the last `set_scene`, except `draws`, `shadow_renders` and `transfers`, which count on.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Stats {
    /// Names of the render pipelines in use, in order of need.
    pub pipelines: Vec<String>,
    /// In the order in which they happened.
    pub uploads: Vec<Upload>,
    /// Draw calls since the renderer was made.
    pub draws: u64,
    /// Triangles in the last picture's leaves and wood, instances counted each.
    pub triangles: u64,
    /// Times the shadow maps were drawn since the renderer was made: once per sun and geometry.
    pub shadow_renders: u64,
    /// Times the transfer's light was worked out since the renderer was made: once a light.
    pub transfers: u64,
}

impl Stats {
    pub(crate) fn upload(&mut self, name: &str, bytes: u64) {
        self.uploads.push(Upload { name: name.to_string(), bytes });
    }

    pub(crate) fn pipeline(&mut self, name: &str) {
        if !self.pipelines.iter().any(|p| p == name) {
            self.pipelines.push(name.to_string());
        }
    }

    /// All bytes uploaded.
    pub fn bytes(&self) -> u64 {
        self.uploads.iter().map(|u| u.bytes).sum()
    }

    /// Whether something with this in its name was uploaded.
    pub fn uploaded(&self, part: &str) -> bool {
        self.uploads.iter().any(|u| u.name.contains(part))
    }
}
