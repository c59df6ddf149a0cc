//! Files that are cut off, damaged or senseless end in a sentence, never in a panic.

use super::writers::*;
use crate::instrument::{read, recognise, sheet};

fn files() -> Vec<(&'static str, Vec<u8>)> {
    let r = |w: f64| 100.0 * leaf(w);
    vec![
        ("sig", sig(&three_detectors(), 100.0, 1.0).into_bytes()),
        ("sed", sed("REFLECTANCE", &["Rad. (Ref.)", "Reflect. %"], |_, w| leaf(w)).into_bytes()),
        ("asd", Asd::counts().bytes()),
        ("asd 1", Asd { version: 1, white: None, format: 1, ..Asd::counts() }.bytes()),
        ("ci710", ci710(";", &[("Reflectance", "a", &r), ("Transmittance", "a", &r)]).into_bytes()),
        ("rxt", rxt(header(0.0), "", "L r t n", &"900 .31 .21 1.4\n".repeat(50)).into_bytes()),
        ("prn", b"\"REM: REFL\"\n\"LIMS: 1\"\n\"INT: 2\"\n350 .1\n352 .2\n".to_vec()),
        ("li180", b"Model Name\tLI-180\n380nm\t1.0\n381nm\t1.0\n".to_vec()),
        (
            "asd text",
            b"Text conversion of header file\ncompared to a white reference\nWavelength\ta\n350\t1\n".to_vec(),
        ),
        ("xlsx", super::workbook::small()),
    ]
}

/// Reads, and checks what holds for every outcome: a sentence of one line, or readings that can be computed with.
fn look(what: &str, bytes: &[u8]) {
    let outcome = match recognise(bytes) {
        None => return,
        Some(crate::instrument::InstrumentFormat::Xlsx) => sheet(bytes).map(|_| None),
        Some(_) => read(bytes, "x").map(Some),
    };
    match outcome {
        Err(why) => assert!(why.len() > 10 && !why.contains('\n'), "{what}: {why}"),
        Ok(Some(file)) => {
            assert_eq!(file.barred.is_some(), file.readings.is_empty(), "{what}: {:?}", file.barred);
            let places = file.readings.iter().all(|r| r.leaf < file.leaves.len());
            assert!(places && file.wavelengths > 0, "{what}");
            assert!(crate::instrument::long_form::table(&file).starts_with(b"leaf"));
        }
        Ok(None) => {}
    }
}

#[test]
fn cut_and_damaged_files_end_in_a_sentence() {
    let mut random = 12345u64;
    let mut next = move |n: usize| {
        random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (random >> 33) as usize % n.max(1)
    };
    for (name, whole) in files() {
        look(name, &whole);
        // Many lengths of the head, and some of the rest.
        for end in (0..whole.len().min(700)).step_by(7).chain((0..20).map(|_| next(whole.len()))) {
            look(name, &whole[..end]);
        }
        for _ in 0..50 {
            let mut bytes = whole.clone();
            for _ in 0..=next(6) {
                // The head holds what is most easily wrong.
                let at = if next(2) == 0 { next(bytes.len().min(700)) } else { next(bytes.len()) };
                bytes[at] = match next(4) {
                    0 => 0,
                    1 => 0xff,
                    2 => b'9',
                    _ => next(256) as u8,
                };
            }
            look(name, &bytes);
        }
    }
}

#[test]
fn senseless_numbers_are_refused() {
    let many = Asd { spectrum: vec![1.0; 65_535], white: None, ..Asd::counts() }.bytes();
    look("many channels", &many);
    for (start, step) in
        [(f32::NAN, 1.0), (350.0, 0.0), (350.0, -1.0), (350.0, f32::INFINITY), (0.0, 1.0), (350.0, 1e30)]
    {
        let why = read(&Asd { start, step, ..Asd::counts() }.bytes(), "x").unwrap_err();
        assert!(why.contains("expected a rising range"), "{why}");
    }
    let why = read(&Asd { spectrum: Vec::new(), white: None, ..Asd::counts() }.bytes(), "x").unwrap_err();
    assert!(why.contains("0 channels"), "{why}");
    let nan = Asd { spectrum: vec![f64::NAN; 2151], ..Asd::counts() };
    assert!(read(&nan.bytes(), "x").unwrap().barred.unwrap().contains("no reading is left"));
    // A hundred thousand lines that go up and down.
    let saw: String = (0..100_000).map(|k| format!("{} 1 1 1\n", 400 + k % 7)).collect();
    let text = format!("/*** Spectra Vista SIG Data ***/\ndata=\n{saw}");
    assert!(read(text.as_bytes(), "x").unwrap_err().contains("go back"));
    let long: String = (0..100_000).map(|k| format!("{:.3} 1 1 50\n", 400.0 + f64::from(k) * 0.01)).collect();
    let text = format!("/*** Spectra Vista SIG Data ***/\ndata=\n{long}");
    assert_eq!(read(text.as_bytes(), "x").unwrap().readings.len(), 100_000);
}
