//! Each form, written from its definition, gives the spectrum that went in.

use super::writers::*;
use crate::instrument::{
    InstrumentFile, InstrumentFormat, ReflectanceUnit, SpectralReading, SpectrumQuantity, read, recognise, through,
};
use std::io::Read;
use std::path::Path;

fn of(bytes: impl AsRef<[u8]>) -> InstrumentFile {
    read(bytes.as_ref(), "maple").unwrap()
}

fn barred(bytes: impl AsRef<[u8]>) -> String {
    let file = of(bytes);
    assert!(file.readings.is_empty());
    file.barred.unwrap()
}

/// All readings are the test leaf's to `within`, times `scale`, and their wavelengths ascend.
fn is_leaf(file: &InstrumentFile, value: fn(&SpectralReading) -> f64, scale: f64, within: f64) {
    assert!(file.barred.is_none() && file.readings.len() > 100, "{:?}", file.barred);
    for (k, r) in file.readings.iter().enumerate() {
        assert!((value(r) - scale * leaf(r.wavelength)).abs() <= within, "{r:?}: {}", leaf(r.wavelength));
        assert!(k == 0 || r.wavelength > file.readings[k - 1].wavelength);
    }
}

/// As a command that reads a table gets it.
fn as_table(bytes: &[u8], name: &str) -> Result<String, String> {
    let (mut source, _) =
        through(Box::new(std::io::Cursor::new(bytes.to_vec())), Path::new(name)).map_err(|e| e.to_string())?;
    let mut text = String::new();
    source.read_to_string(&mut text).unwrap();
    Ok(text)
}

#[test]
fn sig_in_per_cent_and_in_shares_with_overlapping_detectors() {
    let file = of(sig(&three_detectors(), 100.0, 1.0));
    assert_eq!(
        (file.form, file.unit, file.wavelengths),
        (InstrumentFormat::SpectraVista, Some(ReflectanceUnit::PerCent), 957)
    );
    assert_eq!(file.range, Some([340.0, 2515.0]));
    assert!(file.has(SpectrumQuantity::Radiance) && file.has(SpectrumQuantity::Reflectance));
    assert_eq!(file.instrument.as_deref(), Some("HI: 1234567 (HR-1024i)"));
    is_leaf(&file, |r| r.r, 100.0, 1e-4);
    assert!(file.notes.iter().any(|n| n.contains("joined in the middle of their overlap")), "{:?}", file.notes);
    assert_eq!(of(sig(&three_detectors(), 1.0, 1.0)).unit, Some(ReflectanceUnit::Share));
    // A detector that reads 5 % more is noted.
    let step = of(sig(&three_detectors(), 100.0, 1.05));
    assert!(step.notes.iter().any(|n| n.contains("5.0 % more")), "{:?}", step.notes);
    // Ascending wavelengths are taken as they are.
    let joined: Vec<f64> = (0..900).map(|k| 350.0 + 2.0 * f64::from(k)).collect();
    let plain =
        of(sig(&joined, 100.0, 1.0).replace("Overlap: Preserve, Matching", "Overlap: Remove @ 990,1900, Matching"));
    assert_eq!(plain.readings.len(), 900);
    assert!(
        plain.notes.iter().any(|n| n.contains("removed the overlap") && n.contains("@ 990,1900")),
        "{:?}",
        plain.notes
    );
    // Decimal commas, carriage returns alone, UTF-16.
    let text = sig(&joined, 100.0, 1.0);
    let (head, data) = text.split_once("data=").unwrap();
    is_leaf(&of(format!("{head}data={}", data.replace('.', ","))), |r| r.r, 100.0, 1e-4);
    is_leaf(&of(text.replace("\r\n", "\r")), |r| r.r, 100.0, 1e-4);
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(text.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    is_leaf(&of(wide), |r| r.r, 100.0, 1e-4);
}

#[test]
fn sig_without_reflectance_is_barred() {
    let text = "///GER SIGNATUR FILE///\nname= a\nunits= Counts, Counts\ndata=\n350.0 100 50\n351.5 100 60\n";
    assert!(barred(text).contains("raw counts of a reference and of a target"));
}

#[test]
fn sed_by_its_columns_and_its_measurement() {
    let dn = ["Norm. DN (Ref.)", "Norm. DN (Target)", "Reflect. %"];
    let cells = |k: usize, w: f64| [2.0, 2.0 * leaf(w), 100.0 * leaf(w)][k];
    let file = of(sed("REFLECTANCE", &dn, cells));
    assert_eq!(
        (file.form, file.unit, file.range),
        (InstrumentFormat::SpectralEvolution, Some(ReflectanceUnit::PerCent), Some([350.0, 2500.0]))
    );
    assert!(file.has(SpectrumQuantity::Counts));
    is_leaf(&file, |r| r.r, 100.0, 1e-3);
    let share =
        of(sed("REFLECTANCE", &["Rad. (Ref.)", "Rad. (Target)", "Reflect. [1.0]"], |k, w| [2.0, 1.0, leaf(w)][k]));
    assert_eq!(share.unit, Some(ReflectanceUnit::Share));
    is_leaf(&share, |r| r.r, 1.0, 1e-5);
    let through = of(sed("TRANSMITTANCE", &["Reflect. %"], |_, w| 100.0 * leaf(w)));
    assert!(through.has(SpectrumQuantity::Transmittance) && !through.has(SpectrumQuantity::Reflectance));
    is_leaf(&through, |r| r.t, 100.0, 1e-3);
    let radiance = barred(sed("RADIANCE", &["Rad. (Ref.)", "Rad. (Target)"], |_, _| 1.0));
    assert!(radiance.contains("it holds radiance"), "{radiance}");
    assert!(barred(sed("REFLECTANCE", &dn[..2], |_, _| 1.0)).contains("raw counts"));
}

#[test]
fn asd_counts_need_their_reference() {
    for format in 0..3 {
        for version in [2, 3, 4, 5, 6, 7, 8] {
            let file = of(Asd { version, format, ..Asd::counts() }.bytes());
            assert_eq!(
                (file.form, file.unit, file.wavelengths),
                (InstrumentFormat::Asd, Some(ReflectanceUnit::Share), 2151)
            );
            is_leaf(&file, |r| r.r, 1.0, if format == 1 { 1e-4 } else { 1e-6 });
            assert!(file.has(SpectrumQuantity::Counts) && file.has(SpectrumQuantity::Reflectance));
        }
    }
    let none = Asd { white: None, ..Asd::counts() };
    assert!(barred(none.bytes()).contains("raw counts without a white reference"));
    assert!(barred(Asd { version: 1, ..none.clone() }.bytes()).contains("without a white reference"));
    assert!(barred(Asd { dark_corrected: false, ..Asd::counts() }.bytes()).contains("dark current"));
    let cut = Asd::counts().bytes();
    assert!(barred(&cut[..cut.len() - 1]).contains("ends inside its white reference"));
    for (data_type, word) in [(2, "radiance"), (4, "irradiance"), (8, "absorbance"), (5, "unknown"), (99, "unknown")] {
        assert!(barred(Asd { data_type, ..Asd::counts() }.bytes()).contains(word));
    }
    // A dark reference channel costs itself, a saturated detector its range.
    let mut dead = Asd::counts();
    dead.white.as_mut().unwrap()[10] = 0.0;
    let file = of(dead.bytes());
    assert!(file.readings.len() == 2150 && file.readings.iter().all(|r| r.wavelength != 360.0));
    let file = of(Asd { saturation: 2, ..Asd::counts() }.bytes());
    assert!(file.readings.iter().all(|r| r.wavelength <= 1000.0 || r.wavelength > 1800.0));
    assert!(file.notes.iter().any(|n| n.contains("SWIR 1 was saturated")));
}

#[test]
fn asd_reflectance_is_taken_as_stored_or_divided() {
    let spectrum: Vec<f64> = (0..2151).map(|k| leaf(350.0 + f64::from(k))).collect();
    // Version 1 has no reference; a later one may hold the reflectance beside the counts of the reference.
    let stored = Asd { version: 1, data_type: 1, format: 0, spectrum: spectrum.clone(), white: None, ..Asd::counts() };
    is_leaf(&of(stored.bytes()), |r| r.r, 1.0, 1e-6);
    is_leaf(&of(Asd { data_type: 1, spectrum: spectrum.clone(), ..Asd::counts() }.bytes()), |r| r.r, 1.0, 1e-12);
    // The programs also say reflectance of a file with the counts of both.
    is_leaf(&of(Asd { data_type: 1, ..Asd::counts() }.bytes()), |r| r.r, 1.0, 1e-12);
    let through = of(Asd { data_type: 6, ..Asd::counts() }.bytes());
    assert!(through.has(SpectrumQuantity::Transmittance));
    is_leaf(&through, |r| r.t, 1.0, 1e-12);
    assert!(barred(Asd { data_type: 1, white: None, ..Asd::counts() }.bytes()).contains("without a white reference"));
}

#[test]
fn asd_text_says_what_it_holds() {
    let text = |compared: &str| {
        let rows: String = (350..=2500).map(|w| format!("{w}\t {} \n", leaf(f64::from(w)))).collect();
        format!(
            "\nText conversion of header file C:\\transmittance\\x.asd\n ---\nNew ASD spectrum file: Program version = \
             6.04\nVNIR integration time : 34\n{compared}\nSpectrum file is raw data with embedded \
             reference\n\nWavelength\tx.asd\n{rows}"
        )
    };
    let file = of(text("Data is compared to a white reference:"));
    assert_eq!((file.form, file.leaves[0].as_str()), (InstrumentFormat::AsdText, "x"));
    is_leaf(&file, |r| r.r, 1.0, 1e-12);
    assert!(barred(text("Data is not compared to a white reference")).contains("raw counts"));
}

#[test]
fn ci710_pairs_the_modes_of_a_leaf() {
    let (r, t) = (|w: f64| 100.0 * leaf(w), |w: f64| 50.0 * leaf(w));
    for separator in [",", ";", "\t"] {
        let file = of(ci710(
            separator,
            &[
                ("Reflectance", "oak", &r),
                ("Transmittance", "oak", &t),
                ("Absorbance", "oak", &r),
                ("reflectance", "oak", &t),
            ],
        ));
        assert_eq!(
            (file.form, file.unit, file.leaves.len()),
            (InstrumentFormat::Ci710, Some(ReflectanceUnit::PerCent), 2)
        );
        assert_eq!(file.leaves, ["oak", "oak 2"]);
        assert_eq!(
            file.holds,
            [
                (SpectrumQuantity::Reflectance, 2),
                (SpectrumQuantity::Transmittance, 1),
                (SpectrumQuantity::Absorbance, 1)
            ]
        );
        assert_eq!(file.range, Some([150.0, 150.0 + 0.75 * 1599.0]));
        let first = InstrumentFile {
            readings: file.readings.iter().filter(|r| r.leaf == 0).copied().collect(),
            ..file.clone()
        };
        is_leaf(&first, |r| r.r, 100.0, 1e-5);
        is_leaf(&first, |r| r.t, 50.0, 1e-5);
        assert!(first.readings.iter().all(|r| (380.0..=1100.0).contains(&r.wavelength)));
        assert!(file.readings.iter().filter(|r| r.leaf == 1).all(|r| r.t.is_nan()));
    }
    assert!(barred(ci710(",", &[("Absorbance", "", &r)])).contains("absorbance"));
}

#[test]
fn licor_texts() {
    let values: String = (380..=780).map(|w| format!("{w}nm\t{}\n", leaf(f64::from(w)))).collect();
    let text =
        format!("Model Name\tLI-180\nSerial Number\tA1\nTime\t2021/03/02_09:24:26\nPPFD\t129.8\n{values}CCT\t5465.0\n");
    let file = of(text);
    assert_eq!((file.form, file.range, file.wavelengths), (InstrumentFormat::Li180, Some([380.0, 780.0]), 401));
    assert!(file.has(SpectrumQuantity::Irradiance) && file.barred.unwrap().contains("irradiance of a light"));
    let prn = |remark: &str| {
        let values: String = (175..=400).map(|k| format!(" {}  {:.3E}\r\n", 2 * k, leaf(f64::from(2 * k)))).collect();
        format!(
            "\"FILE:A1\"\r\n\"REM: {remark}\"\r\n\"LIMS: 350- 800NM\"\r\n\"INT:  2NM\"\r\n\"DATE:05/30 \
             13:50\"\r\n{values}"
        )
    };
    let file = of(prn("REFL GREEN AD 1 "));
    assert_eq!((file.form, file.unit), (InstrumentFormat::Li1800, Some(ReflectanceUnit::Share)));
    is_leaf(&file, |r| r.r, 1.0, 1e-3);
    is_leaf(&of(prn("trans. of a leaf")), |r| r.t, 1.0, 1e-3);
    assert!(barred(prn("TLD 36W/865 (QNTM)")).contains("irradiance"));
    assert!(barred(prn("leaf 3")).contains("names neither"));
}

#[test]
fn rxt_without_a_sphere_and_in_a_dual_beam() {
    let readings = "1000 0.30 0.20\n 900 0.31 0.21 # second\n\n800\t0.32\t0.0\n";
    let file = of(rxt(header(0.0), "made here", "2", readings));
    assert_eq!(
        (file.form, file.unit, file.index, file.thickness_mm),
        (InstrumentFormat::Iad, Some(ReflectanceUnit::Share), Some(1.4), Some(2.5))
    );
    let found: Vec<_> = file.readings.iter().map(|r| (r.wavelength, r.r, r.t)).collect();
    assert_eq!(found[1..], [(900.0, 0.31, 0.21), (1000.0, 0.3, 0.2)]);
    assert!(found[0].0 == 800.0 && found[0].2.is_nan(), "a transmittance of 0 was not measured");
    assert_eq!(
        as_table(rxt(header(0.0), "", "2", "900 .31 .21\n").as_bytes(), "a b.rxt").unwrap(),
        "leaf,wavelength_nm,R,T,thickness_mm\na b,900.0,0.31,0.21,2.5\n"
    );
    // The whole file on one line, without wavelengths, with carriage returns.
    let line = "IAD1 1.4 1 2.5 0 5 .98 0 200 20 10 5 .97 200 20 0 5 .97 2 .30 .20 .31 .21";
    let file = of(line);
    assert!(file.readings.len() == 2 && file.range.is_none() && file.wavelengths == 2);
    assert_eq!(of(line.replace(' ', "\r")).readings.len(), 2);
    // Letters name columns; index and thickness may differ from row to row.
    let file = of(rxt(
        header(1.0),
        "Process as 'iad -X -i 8 name'",
        "L r t n d",
        "900 .31 .21 1.41 2.0\n1000 .3 .2 1.42 2.1\n",
    ));
    assert_eq!((file.readings[1].index, file.readings[1].thickness_mm), (1.42, 2.1));
    let text = as_table(rxt(header(0.0), "", "L r t n", "900 .31 .21 1.41\n").as_bytes(), "x.rxt").unwrap();
    assert_eq!(text, "leaf,wavelength_nm,R,T,thickness_mm,index\nx,900.0,0.31,0.21,2.5,1.41\n");
}

#[test]
fn rxt_that_only_iad_can_invert_is_barred_by_name() {
    let row = "900 0.31 0.21\n";
    assert!(barred(rxt(header(1.0), "", "2", row)).contains("1 integrating sphere,"));
    assert!(barred(rxt(header(2.0), "run iad -X", "2", row)).contains("2 integrating spheres"));
    assert!(barred(rxt(header(0.0), "", "L r t S", "900 .31 .21 1")).contains("1 integrating sphere,"));
    let mut slides = header(0.0);
    (slides[1], slides[3]) = (1.5, 1.0);
    assert!(barred(rxt(slides, "", "2", row)).contains("slides of index 1.5"));
    assert!(barred(rxt(header(0.0), "", "L r t c", "900 .31 .21 .5")).contains("unscattered light"));
    assert!(barred(rxt(header(0.0), "", "L u", "900 .31")).contains("unscattered transmittance"));
    let wrong = |text: &str| read(text.as_bytes(), "x").unwrap_err();
    assert!(wrong("IAD 1.4 1 2").contains("old form"));
    assert!(wrong("IAD1 1.4 x").contains("\"x\" stands where number 2"));
    assert!(wrong("IAD1 1.4 1").contains("ends after 2 of the 17 numbers"));
    assert!(wrong(&rxt(header(0.0), "", "2", "900 .3 abc")).contains("\"abc\" stands where a number"));
    assert!(wrong(&rxt(header(0.0), "", "9", row)).contains("9 measurements"));
    assert!(wrong(&rxt(header(0.0), "", "L r z", row)).contains("\"z\" is no letter"));
}

#[test]
fn tables_pass_unchanged_and_refusals_name_the_form() {
    let table = "leaf,wavelength_nm,R\na,550,0.1\n".repeat(1000);
    assert_eq!(as_table(table.as_bytes(), "-").unwrap(), table);
    assert_eq!(as_table(b"", "x.csv").unwrap(), "");
    for text in
        ["as6 of spades,b\n1,2\n", "ASD,R450\n1,2\n", "Mode,R450\n1,2\n", "PK\x03\x04", "IADx\n", "name= a\ndata=\n"]
    {
        assert_eq!(recognise(text.as_bytes()), None, "{text}");
    }
    let refused = as_table(&Asd { white: None, ..Asd::counts() }.bytes(), "a.asd").unwrap_err();
    assert!(refused.starts_with("a.asd: an ASD .asd file: it holds raw counts without"), "{refused}");
    let long = as_table(sig(&[500.0, 501.0], 100.0, 1.0).as_bytes(), "leaf.sig").unwrap();
    assert!(long.starts_with("leaf,wavelength_nm,R\nleaf,500.0,"), "{long}");
}

#[test]
fn what_is_stated_is_checked() {
    let stated =
        |bytes: &[u8]| through(Box::new(std::io::Cursor::new(bytes.to_vec())), Path::new("x")).unwrap().1.unwrap();
    let path = Path::new("x");
    let percent = stated(sig(&[500.0, 501.0], 100.0, 1.0).as_bytes());
    assert!(percent.check_percent(path, true).is_ok());
    assert!(percent.check_percent(path, false).unwrap_err().to_string().contains("add --percent"));
    assert!(percent.lacks("rho_t").contains("has no transmittance; it holds reflectance"));
    assert!(percent.lacks("alpha").contains("--percent` takes"));
    let share = stated(rxt(header(0.0), "", "2", "900 .31 .21\n").as_bytes());
    assert!(share.check_percent(path, false).is_ok() && share.check_percent(path, true).is_err());
    assert!(share.check_index(path, 1.0).unwrap_err().to_string().contains("add --index 1.4"));
    assert!(share.check_index(path, 1.41).is_ok() && share.check_index(path, 1.5).is_err());
    assert!(percent.check_index(path, 1.0).is_ok());
}
