//! Counts what is created, uploaded and drawn at the place where it happens. This proves that something was left out.

/// One upload to the adapter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Upload {
    /// Name of the upload, for instance `leaf 0 front gloss`.
    pub name: String,
    /// Number of bytes in the adapter's memory.
    pub bytes: u64,
}

/// Counts since the last `set_scene`. Only `draws`, `shadow_renders` and `transfers` are not reset there.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RenderStatistics {
    /// Names of the render pipelines in use, in the order in which they were needed.
    pub pipelines: Vec<String>,
    /// The uploads, in the order in which they happened.
    pub uploads: Vec<Upload>,
    /// Draw calls since the renderer was made.
    pub draws: u64,
    /// Triangles of leaves and wood in the last picture. Every instance counts. In a browser, those that the adapter
    /// chooses are missing, because they are only known after waiting for it.
    pub triangles: u64,
    /// Triangles in each shadow map that was drawn last. Every instance counts.
    pub shadow_triangles: u64,
    /// Texels along each side of the shadow maps that were drawn last; 0 where none were.
    pub shadow_side: u32,
    /// How often the shadow maps were drawn since the renderer was made: once for each sun and geometry.
    pub shadow_renders: u64,
    /// How often the transfer's light was computed since the renderer was made: once for each light.
    pub transfers: u64,
}

impl RenderStatistics {
    pub(crate) fn upload(&mut self, name: &str, bytes: u64) {
        self.uploads.push(Upload { name: name.to_string(), bytes });
    }

    pub(crate) fn pipeline(&mut self, name: &str) {
        if !self.pipelines.iter().any(|p| p == name) {
            self.pipelines.push(name.to_string());
        }
    }

    /// Number of all bytes uploaded.
    pub fn bytes(&self) -> u64 {
        self.uploads.iter().map(|u| u.bytes).sum()
    }

    /// Whether anything with this in its name was uploaded.
    pub fn uploaded(&self, part: &str) -> bool {
        self.uploads.iter().any(|u| u.name.contains(part))
    }
}
