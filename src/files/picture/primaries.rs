//! The colours that red, green and blue of a picture stand for, and their change to the project's: linear sRGB, which
//! has the primaries and the white of Rec. 709.

use glam::{DMat3, DVec3};

/// CIE x and y of red, green, blue and white.
pub type Primaries = [[f64; 2]; 4];

/// Those of Rec. 709 and sRGB, with the white D65.
pub const REC_709: Primaries = [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3127, 0.329]];
/// Those by which a file says that it holds CIE XYZ itself.
const XYZ: Primaries = [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0 / 3.0, 1.0 / 3.0]];
/// Those that files of film and television state, by name.
const NAMED: [(&str, Primaries); 5] = [
    ("CIE XYZ", XYZ),
    ("ACES AP0", [[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.321_68, 0.337_67]]),
    ("ACES AP1", [[0.713, 0.293], [0.165, 0.83], [0.128, 0.044], [0.321_68, 0.337_67]]),
    ("Rec. 2020", [[0.708, 0.292], [0.17, 0.797], [0.131, 0.046], [0.3127, 0.329]]),
    ("P3 with D65", [[0.68, 0.32], [0.265, 0.69], [0.15, 0.06], [0.3127, 0.329]]),
];
/// Files round chromaticities to three digits.
const SAME: f64 = 1.5e-3;

/// A change of primaries.
#[derive(Debug, Clone, PartialEq)]
pub struct PrimariesChange {
    /// Red, green and blue in linear sRGB are this times those of the file.
    pub matrix: DMat3,
    /// The file's colours in words.
    pub from: String,
}

/// The change from these primaries to linear sRGB; `None` where they are the same. White stays white: the file's is
/// adapted to D65 by Bradford's cone responses. Only CIE XYZ, which has no white of its own, is taken as it is.
///
/// # Errors
/// A sentence where these are no primaries: on a line, or with a white that has no luminance.
pub fn to_srgb(file: &Primaries) -> Result<Option<PrimariesChange>, String> {
    let same =
        |a: &Primaries, b: &Primaries| a.as_flattened().iter().zip(b.as_flattened()).all(|(a, b)| (a - b).abs() < SAME);
    if same(file, &REC_709) {
        return Ok(None);
    }
    let wrong = || format!("chromaticities {file:?} span no colours; expected x and y of red, green, blue and white");
    let (own, srgb) = (xyz_from(file).ok_or_else(wrong)?, xyz_from(&REC_709).ok_or_else(wrong)?);
    let adapted = if same(file, &XYZ) { DMat3::IDENTITY } else { bradford(file[3], REC_709[3]) };
    let named = NAMED.iter().find(|(_, p)| same(file, p));
    let from = named.map_or_else(|| format!("of primaries and white {file:?}"), |(name, _)| format!("in {name}"));
    Ok(Some(PrimariesChange { matrix: srgb.inverse() * adapted * own, from }))
}

/// X, Y, Z of a chromaticity with the luminance 1.
fn lit([x, y]: [f64; 2]) -> DVec3 {
    DVec3::new(x / y, 1.0, (1.0 - x - y) / y)
}

/// The matrix from red, green and blue to XYZ, in which the white has the luminance 1.
fn xyz_from(primaries: &Primaries) -> Option<DMat3> {
    let [r, g, b] = [0, 1, 2].map(|k| {
        let [x, y] = primaries[k];
        DVec3::new(x, y, 1.0 - x - y)
    });
    let columns = DMat3::from_cols(r, g, b);
    let white = lit(primaries[3]);
    let shares = columns.inverse() * white;
    (columns.determinant().abs() > 1e-6 && white.is_finite() && shares.min_element() > 0.0)
        .then(|| columns * DMat3::from_diagonal(shares))
}

/// Bradford's adaptation from one white to another (Lam 1985).
fn bradford(from: [f64; 2], to: [f64; 2]) -> DMat3 {
    let cones = DMat3::from_cols_array(&[0.8951, -0.7502, 0.0389, 0.2664, 1.7135, -0.0685, -0.1614, 0.0367, 1.0296]);
    let gain = (cones * lit(to)) / (cones * lit(from));
    cones.inverse() * DMat3::from_diagonal(gain) * cones
}

#[cfg(test)]
mod tests {
    use super::*;

    fn change(file: &Primaries) -> DMat3 {
        to_srgb(file).unwrap().unwrap().matrix
    }

    fn near(matrix: DMat3, rows: [[f64; 3]; 3], within: f64) {
        let got = matrix.transpose().to_cols_array_2d();
        assert!(got.as_flattened().iter().zip(rows.as_flattened()).all(|(a, b)| (a - b).abs() < within), "{got:?}");
    }

    /// The published matrices: IEC 61966-2-1 for XYZ, and the Academy's for ACES (S-2014-004, Bradford).
    #[test]
    fn published_matrices_are_met() {
        let xyz = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.204, 1.057]];
        near(change(&XYZ), xyz, 5e-4);
        let ap0 = [
            [2.521_686, -1.134_131, -0.387_555],
            [-0.276_480, 1.372_719, -0.096_239],
            [-0.015_378, -0.152_975, 1.168_353],
        ];
        near(change(&NAMED[1].1), ap0, 2e-4);
        let ap1 = [
            [1.705_051, -0.621_792, -0.083_259],
            [-0.130_256, 1.140_805, -0.010_548],
            [-0.024_003, -0.128_969, 1.152_972],
        ];
        near(change(&NAMED[2].1), ap1, 2e-4);
    }

    #[test]
    fn white_stays_white_and_the_own_primaries_stay() {
        for (_, primaries) in NAMED.iter().skip(1) {
            assert!((change(primaries) * DVec3::ONE - DVec3::ONE).length() < 1e-12);
        }
        assert_eq!(to_srgb(&REC_709), Ok(None));
        let line = [[0.6, 0.3], [0.5, 0.35], [0.4, 0.4], [0.3127, 0.329]];
        assert!(to_srgb(&line).unwrap_err().contains("span no colours"));
        assert!(to_srgb(&[[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3, 0.0]]).is_err());
    }
}
