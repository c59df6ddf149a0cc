//! RGL's tensor file: "tensor_file", a version, and named arrays with their types, shapes and places.

use crate::{Error, Result};
use mesophyll_files::atomic::explain;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Limits beyond which a file is damaged: fields, letters of a name, dimensions, and bytes of one array.
const FIELDS: u32 = 64;
const NAME: u16 = 256;
const DIMENSIONS: u16 = 8;
const BYTES: u64 = 1 << 30;

/// Types of numbers, as the file counts them from 1, and their bytes.
const TYPES: [usize; 11] = [1, 1, 2, 2, 4, 4, 8, 8, 2, 4, 8];
const FLOAT32: u8 = 10;

/// An array that has not been read.
#[derive(Debug, Clone, PartialEq)]
pub struct TensorField {
    name: String,
    dtype: u8,
    offset: u64,
    /// Its shape.
    pub shape: Vec<usize>,
}

/// An opened file.
#[derive(Debug)]
pub struct TensorFile {
    path: PathBuf,
    file: File,
    fields: Vec<TensorField>,
}

impl TensorFile {
    /// Reads the list of arrays.
    ///
    /// # Errors
    /// [`Error::Input`] with the number that is wrong.
    pub fn open(path: &Path) -> Result<TensorFile> {
        let failed = |e: std::io::Error| Error::input(path, explain(&e));
        let mut file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let mut take = |n: usize| -> Result<Vec<u8>> {
            let mut bytes = vec![0; n];
            file.read_exact(&mut bytes).map_err(|_| Error::input(path, "ends within the list of its arrays"))?;
            Ok(bytes)
        };
        let number = |bytes: &[u8]| bytes.iter().rev().fold(0u64, |sum, b| sum << 8 | u64::from(*b));
        let head = take(14)?;
        if &head[..12] != b"tensor_file\0" {
            return Err(Error::input(path, "does not begin with \"tensor_file\""));
        }
        if head[12] != 1 {
            return Err(Error::input(path, format!("found version {}.{}, expected 1.0", head[12], head[13])));
        }
        let bad = |what: &str, found: u64, most: u64| {
            Error::input(path, format!("{what}: found {found}, expected at most {most}"))
        };
        let count = number(&take(4)?);
        if count > u64::from(FIELDS) {
            return Err(bad("arrays", count, FIELDS.into()));
        }
        let mut fields = Vec::new();
        for _ in 0..count {
            let letters = number(&take(2)?);
            if letters > u64::from(NAME) {
                return Err(bad("letters of an array's name", letters, NAME.into()));
            }
            let name = String::from_utf8_lossy(&take(letters as usize)?).into_owned();
            let dimensions = number(&take(2)?);
            if dimensions > u64::from(DIMENSIONS) {
                return Err(bad(&format!("dimensions of {name}"), dimensions, DIMENSIONS.into()));
            }
            let dtype = take(1)?[0];
            let offset = number(&take(8)?);
            let shape: Vec<u64> = (0..dimensions).map(|_| Ok(number(&take(8)?))).collect::<Result<_>>()?;
            let size = usize::from(dtype).checked_sub(1).and_then(|k| TYPES.get(k)).copied();
            let Some(size) = size else {
                return Err(Error::input(path, format!("{name}: found type {dtype}, expected 1 to {}", TYPES.len())));
            };
            let bytes = shape.iter().try_fold(size as u64, |all, n| all.checked_mul(*n));
            let end = bytes.and_then(|b| b.checked_add(offset));
            match (bytes, end) {
                (Some(bytes), Some(end)) if bytes <= BYTES && end <= length => {}
                _ => {
                    let most = BYTES.min(length);
                    return Err(Error::input(
                        path,
                        format!(
                            "{name}: found shape {shape:?} at byte {offset}, expected at most {most} bytes in the file"
                        ),
                    ));
                }
            }
            fields.push(TensorField { name, dtype, offset, shape: shape.into_iter().map(|n| n as usize).collect() });
        }
        Ok(TensorFile { path: path.to_path_buf(), file, fields })
    }

    /// An array by name.
    pub fn find(&self, name: &str) -> Option<&TensorField> {
        self.fields.iter().find(|f| f.name == name)
    }

    /// The numbers of an array of `dimensions` dimensions, and its shape.
    ///
    /// # Errors
    /// [`Error::Input`] where there is none, or one of another type or shape.
    pub fn floats(&mut self, name: &str, dimensions: usize) -> Result<(Vec<usize>, Vec<f64>)> {
        let Some(field) = self.find(name).cloned() else {
            return Err(Error::field(&self.path, name, "missing"));
        };
        if field.dtype != FLOAT32 {
            let found = format!("found type {}", field.dtype);
            return Err(Error::field(&self.path, name, format!("{found}, expected {FLOAT32} (32-bit numbers)")));
        }
        if field.shape.len() != dimensions || field.shape.contains(&0) {
            let found = format!("found shape {:?}", field.shape);
            return Err(Error::field(&self.path, name, format!("{found}, expected {dimensions} dimensions")));
        }
        let count: usize = field.shape.iter().product();
        let failed = |e: std::io::Error| Error::input(&self.path, explain(&e));
        let mut bytes = vec![0; 4 * count];
        self.file.seek(SeekFrom::Start(field.offset)).map_err(failed)?;
        self.file.read_exact(&mut bytes).map_err(failed)?;
        let numbers = bytes.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])));
        Ok((field.shape, numbers.collect()))
    }

    /// A byte that says yes or no; yes where it is missing.
    ///
    /// # Errors
    /// [`Error::Input`] where it cannot be read.
    pub fn flag(&mut self, name: &str) -> Result<bool> {
        let Some(field) = self.find(name).filter(|f| f.shape == [1]).cloned() else { return Ok(true) };
        let mut byte = [1];
        let failed = |e: std::io::Error| Error::input(&self.path, explain(&e));
        self.file.seek(SeekFrom::Start(field.offset)).map_err(failed)?;
        self.file.read_exact(&mut byte).map_err(failed)?;
        Ok(byte[0] != 0)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}
