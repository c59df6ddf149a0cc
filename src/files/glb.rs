//! A binary glTF 2.0 file while it is built: one buffer, its views and accessors, and its pictures. The writer of the
//! file adds what they mean (nodes, meshes, materials).

use crate::{Error, Result, atomic};
use serde_json::{Value, json};
use std::path::Path;

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const UNSIGNED_SHORT: u32 = 5123;

/// Buffer, accessors and images of a file that is being written.
#[derive(Debug)]
pub struct Glb {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    images: Vec<Value>,
    textures: Vec<Value>,
    samplers: Vec<Value>,
    /// The sampler of the pictures that are added, and its modes beyond the edges.
    sampler: Option<usize>,
    modes: [u64; 2],
}

const CLAMP_TO_EDGE: u64 = 33071;

impl Default for Glb {
    fn default() -> Glb {
        Glb::onto(&mut Value::Null, Vec::new())
    }
}

impl Glb {
    /// Goes on with a file that exists: `root` is its JSON, whose lists are taken out of it, and `bin` its only buffer.
    pub fn onto(root: &mut Value, bin: Vec<u8>) -> Glb {
        let mut list = |name: &str| match root.get_mut(name).map(Value::take) {
            Some(Value::Array(list)) => list,
            _ => Vec::new(),
        };
        Glb {
            bin,
            views: list("bufferViews"),
            accessors: list("accessors"),
            images: list("images"),
            textures: list("textures"),
            samplers: list("samplers"),
            sampler: None,
            modes: [CLAMP_TO_EDGE; 2],
        }
    }

    /// Adds bytes as they are, in a view of their own. Returns the view's index.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.bin.len().is_multiple_of(4) {
            self.bin.push(0);
        }
        self.views.push(json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()}));
        self.bin.extend_from_slice(bytes);
        self.views.len() - 1
    }

    /// Adds vectors of `N` numbers; `kind` is glTF's name for them (`VEC3`). Returns the accessor's index.
    pub fn floats<const N: usize>(&mut self, kind: &str, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let mut accessor = json!({"bufferView": view, "componentType": FLOAT, "count": values.len(), "type": kind});
        if N == 3 {
            let bound = |pick: fn(f32, f32) -> f32, start: f32| -> Vec<f32> {
                (0..3).map(|c| values.iter().map(|v| v[c]).fold(start, pick)).collect()
            };
            accessor["min"] = json!(bound(f32::min, f32::INFINITY));
            accessor["max"] = json!(bound(f32::max, f32::NEG_INFINITY));
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds indices of vertices. Returns the accessor's index.
    pub fn indices(&mut self, values: &[u32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes);
        self.accessors
            .push(json!({"bufferView": view, "componentType": UNSIGNED_INT, "count": values.len(), "type": "SCALAR"}));
        self.accessors.len() - 1
    }

    /// Adds the times of an animation (s), in rising order. Returns the accessor's index.
    pub fn times(&mut self, values: &[f32]) -> usize {
        let each: Vec<[f32; 1]> = values.iter().map(|v| [*v]).collect();
        let accessor = self.floats("SCALAR", &each);
        self.accessors[accessor]["min"] = json!(values.first().map(|v| [v]));
        self.accessors[accessor]["max"] = json!(values.last().map(|v| [v]));
        accessor
    }

    /// Adds the joints of vertices, as numbers in their skin. Returns the accessor's index.
    pub fn joints(&mut self, values: &[[u16; 4]]) -> usize {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let accessor =
            json!({"bufferView": view, "componentType": UNSIGNED_SHORT, "count": values.len(), "type": "VEC4"});
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Sets how pictures that are added from now on continue beyond their edges, across and down (glTF's `wrapS` and
    /// `wrapT`).
    pub fn wrap(&mut self, modes: [u64; 2]) {
        (self.modes, self.sampler) = (modes, None);
    }

    /// Adds a picture and returns a texture reference to it. It is sampled linearly, and clamped to its edge unless
    /// [`Glb::wrap`] said something else.
    pub fn texture(&mut self, name: &str, png: &[u8]) -> Value {
        let view = self.view(png);
        self.images.push(json!({"name": name, "bufferView": view, "mimeType": "image/png"}));
        let samplers = &mut self.samplers;
        let sampler = *self.sampler.get_or_insert_with(|| {
            let [s, t] = self.modes;
            samplers.push(json!({"magFilter": 9729, "minFilter": 9987, "wrapS": s, "wrapT": t}));
            samplers.len() - 1
        });
        self.textures.push(json!({"source": self.images.len() - 1, "sampler": sampler}));
        json!({"index": self.textures.len() - 1})
    }

    /// Writes `path` (.glb), completely or not at all. `root` is the rest of the file's JSON.
    ///
    /// # Errors
    /// As [`atomic::write_bytes`].
    pub fn write(self, path: &Path, mut root: Value) -> Result<()> {
        for (name, list) in [("textures", self.textures), ("samplers", self.samplers), ("images", self.images)] {
            // A list of glTF may not be empty.
            match root.as_object_mut() {
                Some(root) if list.is_empty() => drop(root.remove(name)),
                _ => root[name] = json!(list),
            }
        }
        root["accessors"] = json!(self.accessors);
        root["bufferViews"] = json!(self.views);
        root["buffers"] = json!([{"byteLength": self.bin.len()}]);
        let json = serde_json::to_vec(&root).map_err(|e| Error::write(path, e))?;
        let header = gltf::binary::Header { magic: *b"glTF", version: 2, length: 0 };
        let glb = gltf::binary::Glb { header, json: json.into(), bin: Some(self.bin.into()) };
        let bytes = glb.to_vec().map_err(|e| Error::write(path, e))?;
        atomic::write_bytes(path, &bytes)
    }
}

/// The file's statement about the program that wrote it.
pub fn asset() -> Value {
    json!({"version": "2.0", "generator": concat!("mesophyll ", env!("CARGO_PKG_VERSION"))})
}
