//! Reading and writing. The renderer validates the scene itself when it is set, so only what this file adds is
//! validated here.

use crate::bundle::Bundle;
use flate2::{Compression, read::GzDecoder, write::GzEncoder};
use std::io::{Read, Write};

/// The first bytes of a file.
const MAGIC: &[u8; 8] = b"MESOPHYL";
/// The version of the format. A program reads files of its own version.
pub const VERSION: u32 = 2;
/// The largest size of the uncompressed contents (bytes). A page in a browser has at most 4 GiB of memory, and the
/// scene is there twice while it is read.
pub const LARGEST: u64 = 1 << 30;

/// Why bytes are not a scene.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Another kind of file.
    #[error("found another kind of file, expected one that `mesophyll export --to web` wrote")]
    Kind,
    /// A file of another version.
    #[error("found version {found} of the format, expected version {VERSION}; export the scene again")]
    Version {
        /// The version that the file states.
        found: u32,
    },
    /// A scene that is larger than a page can hold.
    #[error("found more than {} MiB, expected at most that", LARGEST >> 20)]
    Large,
    /// Damaged contents.
    #[error("the contents are damaged: {0}")]
    Damaged(String),
}

fn damaged(error: impl ToString) -> Error {
    Error::Damaged(error.to_string())
}

impl Bundle {
    /// The bytes of a file. The same bundle gives the same bytes.
    ///
    /// # Errors
    /// `Large` where the contents are larger than [`LARGEST`].
    pub fn write(&self) -> Result<Vec<u8>, Error> {
        let mut contents = Vec::new();
        ciborium::into_writer(self, &mut contents).map_err(damaged)?;
        if contents.len() as u64 > LARGEST {
            return Err(Error::Large);
        }
        let mut out = MAGIC.to_vec();
        out.extend(VERSION.to_le_bytes());
        let mut packed = GzEncoder::new(out, Compression::default());
        packed.write_all(&contents).map_err(damaged)?;
        packed.finish().map_err(damaged)
    }

    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// One sentence that says what was found and what was expected.
    pub fn read(bytes: &[u8]) -> Result<Bundle, Error> {
        let Some((version, packed)) = bytes.strip_prefix(MAGIC).and_then(|rest| rest.split_first_chunk::<4>()) else {
            return Err(Error::Kind);
        };
        match u32::from_le_bytes(*version) {
            VERSION => {}
            found => return Err(Error::Version { found }),
        }
        let mut contents = Vec::new();
        GzDecoder::new(packed).take(LARGEST + 1).read_to_end(&mut contents).map_err(damaged)?;
        if contents.len() as u64 > LARGEST {
            return Err(Error::Large);
        }
        let mut bundle: Bundle = ciborium::from_reader(contents.as_slice()).map_err(damaged)?;
        bundle.scene.sections = bundle.still.as_ref().map(crate::bundle::StillSections::sections);
        bundle.validate()?;
        Ok(bundle)
    }

    fn validate(&self) -> Result<(), Error> {
        if self.views.is_empty() {
            return Err(damaged("it has no view"));
        }
        for view in &self.views {
            if view.size.iter().any(|side| !(1..=8192).contains(side)) {
                let [width, height] = view.size;
                return Err(damaged(format!("view {}: found {width}x{height} pixels, expected 1 to 8192", view.name)));
            }
        }
        for leaf in &self.leaves {
            if self.scene.leaf(leaf.material).is_none() {
                return Err(damaged(format!("slabs of material {}, which is no leaf", leaf.material)));
            }
        }
        Ok(())
    }
}
