//! What a file is by its first bytes, for those that expected another one.

/// First bytes of forms that no command reads, what they are, and what helps.
pub const FOREIGN: [(&[u8], &str, &str); 11] = [
    (b"\x1f\x8b", "a gzip archive", "unpack it first"),
    (b"PK\x03\x04", "a ZIP archive", "unpack it first"),
    (b"PK\x05\x06", "an empty ZIP archive", "there is nothing in it"),
    (b"BZh", "a bzip2 archive", "unpack it first"),
    (b"\xfd7zXZ\0", "an xz archive", "unpack it first"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an Excel workbook of the old form (.xls)", "save it as .xlsx or CSV"),
    (b"%PDF", "a PDF document", "save its table as CSV"),
    (b"\x93NUMPY", "a NumPy array", "save it as CSV with a line of names"),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file", "save its table as CSV"),
    (b"CDF\x01", "a NetCDF file", "save its table as CSV"),
    (b"CDF\x02", "a NetCDF file", "save its table as CSV"),
];

/// First bytes of pictures, and what they are.
pub const PICTURES: [(&[u8], &str); 7] = [
    (b"\x89PNG\r\n\x1a\n", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"II*\0", "a TIFF picture"),
    (b"MM\0*", "a TIFF picture"),
    (b"\x76\x2f\x31\x01", "an OpenEXR picture"),
    (b"#?R", "a Radiance picture (.hdr)"),
    (b"P6\n", "a PPM picture"),
];

/// First bytes of models and scenes that other programs write and that are not read here, and what they are.
const MODELS: [(&[u8], &str); 10] = [
    (b"Kaydara FBX", "an FBX file"),
    (b"; FBX", "an FBX file"),
    (b"BLENDER", "a Blender file (.blend)"),
    (b"#usda", "an OpenUSD text (.usda)"),
    (b"PXR-USDC", "an OpenUSD file (.usdc)"),
    (b"ply\n", "a PLY file"),
    (b"ply\r", "a PLY file"),
    (b"solid ", "an STL file"),
    (b"<?xml", "an XML text"),
    (b"{", "a JSON text, such as a .gltf file"),
];

/// First words of the lines of a Wavefront OBJ file.
const OF_OBJ: [&str; 9] = ["v", "vn", "vt", "f", "o", "g", "s", "usemtl", "mtllib"];

/// Number of bytes among which the first line of an OBJ file is looked for, after lines of remarks.
const HEAD: usize = 4096;

/// What a file that begins with `head` is, where it is a form that is known here.
pub fn form(head: &[u8]) -> Option<&'static str> {
    if head.starts_with(b"glTF") {
        return Some("a binary glTF file (.glb)");
    }
    let picture = PICTURES.iter().find(|(magic, _)| head.starts_with(magic)).map(|(_, form)| *form);
    let foreign = || FOREIGN.iter().find(|(magic, ..)| head.starts_with(magic)).map(|(_, form, _)| *form);
    picture.or_else(foreign).or_else(|| model(head))
}

/// The same for models and scenes of other programs alone, most of which are texts.
pub fn model(head: &[u8]) -> Option<&'static str> {
    if let Some((_, form)) = MODELS.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Some(*form);
    }
    let text = String::from_utf8_lossy(&head[..head.len().min(HEAD)]);
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let mut words = lines.next()?.split_whitespace();
    let is_obj = words.next().is_some_and(|word| OF_OBJ.contains(&word)) && words.next().is_some_and(|w| w != "=");
    is_obj.then_some("a Wavefront OBJ file")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_told_by_its_beginning() {
        for (head, expected) in [
            (&b"glTF\x02\0\0\0"[..], Some("a binary glTF file (.glb)")),
            (b"\x89PNG\r\n\x1a\n", Some("a PNG picture")),
            (b"\x1f\x8b\x08", Some("a gzip archive")),
            (b"# Blender 4\n\nmtllib a.mtl\n", Some("a Wavefront OBJ file")),
            (b"v 0 0 1\r\nv 1 0 0\r\n", Some("a Wavefront OBJ file")),
            (b"solid leaf\n", Some("an STL file")),
            // Texts of this program's own.
            (b"# A scene\nschema = 1\n", None),
            (b"g = 1\n", None),
            (b"", None),
        ] {
            assert_eq!(form(head), expected, "{}", String::from_utf8_lossy(head));
        }
    }
}
