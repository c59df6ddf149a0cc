//! Spectra as a CSV in long form, a row a wavelength.

use super::{InstrumentFile, SpectralReading};
use crate::table::{push_number, push_quoted};

/// `leaf,wavelength_nm,R,T,thickness_mm,index` with a row a reading. A column that no reading has is left out.
pub(super) fn table(file: &InstrumentFile) -> Vec<u8> {
    type Of = fn(&SpectralReading) -> f64;
    let columns: [(&str, Of); 5] = [
        ("wavelength_nm", |r| r.wavelength),
        ("R", |r| r.r),
        ("T", |r| r.t),
        ("thickness_mm", |r| r.thickness_mm),
        ("index", |r| r.index),
    ];
    let thickness = file.thickness_mm.unwrap_or(f64::NAN);
    let readings = || {
        file.readings.iter().map(|r| SpectralReading {
            thickness_mm: if r.thickness_mm.is_nan() { thickness } else { r.thickness_mm },
            ..*r
        })
    };
    let there: Vec<_> = columns.into_iter().filter(|(_, of)| readings().any(|r| !of(&r).is_nan())).collect();
    let mut bytes = b"leaf".to_vec();
    there.iter().for_each(|(name, _)| {
        bytes.push(b',');
        push_quoted(&mut bytes, name);
    });
    bytes.push(b'\n');
    for reading in readings() {
        push_quoted(&mut bytes, &file.leaves[reading.leaf]);
        for (_, of) in &there {
            bytes.push(b',');
            let value = of(&reading);
            push_number(&mut bytes, if value.is_finite() { value } else { f64::NAN });
        }
        bytes.push(b'\n');
    }
    bytes
}
