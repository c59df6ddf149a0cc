//! Real files of instruments, where the folder of measurements has them.

use crate::instrument::{InstrumentFile, ReflectanceUnit, SpectrumQuantity, read};
use crate::skips;
use std::path::PathBuf;

fn folder() -> Option<PathBuf> {
    let folder = skips::data("files of instruments")?.join("instruments");
    if !folder.is_dir() {
        skips::skip(skips::Need::Data, "MESOPHYLL_DATA has no folder instruments");
        return None;
    }
    Some(folder)
}

fn of(folder: &std::path::Path, name: &str) -> InstrumentFile {
    read(&std::fs::read(folder.join(name)).unwrap(), "leaf").unwrap()
}

/// The reading nearest to a wavelength.
fn near(file: &InstrumentFile, w: f64) -> [f64; 2] {
    let distance = |r: &&crate::instrument::SpectralReading| (r.wavelength - w).abs();
    file.readings.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).map(|r| [r.r, r.t]).unwrap()
}

/// A green leaf reflects little in the red and much beyond it.
#[test]
fn leaves_of_field_spectrometers_are_green() {
    let Some(folder) = folder() else { return };
    for (name, scale) in [("svc_overlap.sig", 100.0), ("svc_raw.sig", 100.0), ("psr.sed", 100.0)] {
        let file = of(&folder, name);
        assert!(file.barred.is_none() && file.unit == Some(ReflectanceUnit::PerCent), "{name}");
        assert!(file.readings.windows(2).all(|p| p[1].wavelength > p[0].wavelength), "{name}");
        let (red, infrared) = (near(&file, 670.0)[0] / scale, near(&file, 800.0)[0] / scale);
        assert!(red < 0.5 * infrared && infrared < 0.8, "{name}: {red} {infrared}");
    }
    for name in ["v6.asd", "v8.asd"] {
        let file = of(&folder, name);
        assert!(
            file.has(SpectrumQuantity::Counts) && file.has(SpectrumQuantity::Reflectance) && file.wavelengths == 2151,
            "{name}"
        );
        assert!(file.readings.iter().all(|r| r.r > 0.0 && r.r < 1.1), "{name}");
    }
}

#[test]
fn tables_of_two_quantities_and_of_spheres() {
    let Some(folder) = folder() else { return };
    let ci = of(&folder, "ci710.csv");
    assert!(ci.unit == Some(ReflectanceUnit::PerCent) && ci.has(SpectrumQuantity::Reflectance));
    let phantom = of(&folder, "phantom.rxt");
    assert_eq!((phantom.index, phantom.thickness_mm), (Some(1.41), Some(2.65)));
    assert!(phantom.barred.is_none());
    assert_eq!(near(&phantom, 1500.0), [0.2995, 0.35218]);
    let sphere = of(&folder, "one_sphere.rxt");
    assert!(sphere.barred.unwrap().contains("1 integrating sphere"));
}
