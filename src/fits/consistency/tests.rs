//! Every tampering writes its hashes anew, as someone would who wants it to go unnoticed.

use super::*;
use mesophyll_files::hash;
use mesophyll_files::image::{Packing, write_exr};

fn committed(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fits").join(name)
}

/// A copy of a committed fit that a test may change.
struct Copy(tempfile::TempDir);

impl Copy {
    fn of(name: &str) -> Copy {
        let dir = tempfile::tempdir().unwrap();
        for entry in std::fs::read_dir(committed(name)).unwrap().flatten() {
            std::fs::copy(entry.path(), dir.path().join(entry.file_name())).unwrap();
        }
        Copy(dir)
    }

    /// Changes the samples of some channels where the mask says good, or everywhere.
    fn map(&self, file: &str, everywhere: bool, change: impl Fn(&str, f32) -> f32) {
        let path = self.0.path().join(file);
        let mask = read_exr(&self.0.path().join(file.replace("_err", ""))).unwrap();
        let mask = mask.scalar(Quantity::Mask).unwrap();
        let mut maps = read_exr(&path).unwrap();
        for (name, plane) in &mut maps.channels {
            let some = plane.iter_mut().zip(mask).filter(|(_, m)| everywhere || **m == 1.0);
            some.for_each(|(v, _)| *v = change(name, *v));
        }
        write_exr(&path, &maps, Packing::Zip).unwrap();
        self.record(|_| ());
    }

    /// Changes the record, and writes every hash anew.
    fn record(&self, change: impl FnOnce(&mut FitRecord)) {
        let folder = self.0.path();
        let mut record = FitRecord::read(folder).unwrap();
        change(&mut record);
        for (name, hash) in &mut record.files {
            *hash = hash::file(&folder.join(name)).unwrap();
        }
        record.write(folder).unwrap();
    }

    fn faults(&self) -> ConsistencyFaults {
        of(self.0.path()).unwrap()
    }
}

#[test]
fn committed_fits_agree_with_themselves() {
    for name in ["elm", "balata", "elm-twig"] {
        let clock = std::time::Instant::now();
        let found = of(&committed(name)).unwrap();
        println!("{name}: {:.2} s", clock.elapsed().as_secs_f64());
        assert_eq!(found.all().count(), 0, "{found:#?}");
    }
}

#[test]
fn a_map_changed_and_hashed_anew_is_named_with_its_channel() {
    type Change = fn(&str, f32) -> f32;
    const NAN: f32 = f32::NAN;
    // The file, what is done to it, and the file and words that must be said.
    let cases: [(&str, Change, &str, &str); 17] = [
        ("front.exr", |c, v| if c.starts_with("gamma") { 0.8 * v } else { v }, "front.exr", "gamma.R"),
        ("back.exr", |c, v| if c.starts_with("rho_t") { 1.5 * v } else { v }, "back.exr", "rho_t.G"),
        ("front.exr", |c, v| if c == "rho_d.B" { NAN } else { v }, "front.exr", "rho_d.B holds NaN"),
        ("front.exr", |c, v| if c == "thickness.Y" { NAN } else { v }, "front.exr", "thickness.Y holds NaN"),
        ("front.exr", |c, v| if c.starts_with("sigma_a") { 1.5 * v } else { v }, "front.exr", "sigma_a.R"),
        ("front.exr", |c, v| if c.starts_with("sigma_s") { 1.5 * v } else { v }, "front.exr", "sigma_s.R"),
        ("front.exr", |c, v| if c == "thickness.Y" { 1.1 * v } else { v }, "front.exr", "thickness.Y"),
        ("front.exr", |c, v| if c == "normal.X" { 0.5 * v } else { v }, "front.exr", "the length of normal"),
        ("front.exr", |c, v| if c == "reduced_chi2.Y" { 0.5 * v } else { v }, "front.exr", "reduced_chi2.Y"),
        ("front.exr", |c, v| if c.starts_with("rho_s") { -v - 1e-6 } else { v }, "front.exr", "rho_s.R holds -"),
        // γ and ρd together are the slab's, but not in the mean, nor those of the maps of σ.
        (
            "front.exr",
            |c, v| if c.starts_with("gamma") || c.starts_with("rho_d") { 0.8 * v } else { v },
            "front.exr",
            "the mean of gamma.R",
        ),
        ("front_err.exr", |_, v| 0.1 * v, "front_err.exr", "errors of rho_d"),
        ("front_err.exr", |c, v| if c.starts_with("rho_d") { 0.1 * v } else { v }, "front_err.exr", "errors of rho_d"),
        ("front_err.exr", |c, v| if c.starts_with("rho_s") { 0.1 * v } else { v }, "front_err.exr", "errors of rho_s"),
        ("back_err.exr", |c, v| if c == "m.Y" { 0.1 * v } else { v }, "back_err.exr", "errors of m"),
        ("back_err.exr", |c, v| if c == "thickness.Y" { 0.1 * v } else { v }, "back_err.exr", "thickness.Y"),
        ("back_err.exr", |c, v| if c == "sigma_a.G" { 0.1 * v } else { v }, "back_err.exr", "sigma_a.G"),
    ];
    for (n, (file, change, named, words)) in cases.into_iter().enumerate() {
        let fit = ["elm", "balata"][n % 2];
        let copy = Copy::of(fit);
        copy.map(file, !words.contains("rho_s"), change);
        let found = copy.faults();
        assert_eq!(found.changed, [], "{found:?}");
        let said = |s: &String| s.contains(named) && s.contains(words);
        assert!(found.contradictions.iter().any(said), "{fit}, {file}, {words}: {found:#?}");
    }
}

#[test]
fn a_number_changed_and_hashed_anew_is_named_with_its_field() {
    fn param<'a>(record: &'a mut FitRecord, side: &str, name: &str) -> &'a mut FitParameter {
        record.sections.get_mut(side).unwrap().params.get_mut(name).unwrap()
    }
    type Change = fn(&mut FitRecord);
    let cases: [(&str, Change); 11] = [
        ("edited_from", |r| drop(r.options.insert("edited_from".into(), "elm".into()))),
        ("sigma_a.R", |r| param(r, "front", "sigma_a").value[0] *= 1.5),
        ("sigma_s.G", |r| param(r, "back", "sigma_s").value[1] *= 0.9),
        ("thickness", |r| param(r, "front", "thickness").value[0] *= 1.1),
        ("sigma_a.R", |r| param(r, "front", "sigma_a").stderr.iter_mut().for_each(|e| *e /= 10.0)),
        ("sigma_s.B", |r| {
            ["front", "back"].iter().for_each(|s| param(r, s, "sigma_s").stderr.iter_mut().for_each(|e| *e /= 10.0))
        }),
        ("residuals.transmittance", |r| {
            r.sections.get_mut("front").unwrap().residuals.get_mut("transmittance").unwrap().chi2 *= 0.1;
        }),
        ("residuals.gloss", |r| {
            r.sections.get_mut("front").unwrap().residuals.get_mut("gloss").unwrap().reduced_chi2 = 0.5;
        }),
        ("counts", |r| *r.sections.get_mut("back").unwrap().counts.get_mut("good").unwrap() -= 100),
        ("correlation", |r| r.sections.get_mut("back").unwrap().correlation[0][1] = 0.99),
        ("mask.Y", |r| {
            let counts = &mut r.sections.get_mut("back").unwrap().counts;
            *counts.get_mut("good").unwrap() -= 100;
            *counts.get_mut("outside").unwrap() += 100;
        }),
    ];
    for (n, (words, change)) in cases.into_iter().enumerate() {
        let fit = ["elm", "balata"][n % 2];
        let copy = Copy::of(fit);
        copy.record(change);
        let found = copy.faults();
        assert!(found.contradictions.iter().any(|s| s.contains(words)), "{fit}, {words}: {found:#?}");
    }
}

/// A fit without the sides' comparison has the errors of its texels to be held against.
#[test]
fn errors_of_a_single_side_are_held_against_those_of_its_texels() {
    let alone = |factor: f64| {
        let copy = Copy::of("elm");
        copy.record(|record| {
            record.sections.remove("back");
            record.sections.remove(crate::leaf::sides::SECTION);
            record.files.retain(|name, _| !name.starts_with("back"));
            for name in ["sigma_a", "sigma_s"] {
                let param = record.sections.get_mut("front").unwrap().params.get_mut(name).unwrap();
                param.stderr.iter_mut().for_each(|e| *e *= factor);
            }
        });
        copy.faults().contradictions
    };
    assert_eq!(alone(1.0), Vec::<String>::new());
    for factor in [0.1, 10.0] {
        let said = alone(factor);
        assert!(said.iter().any(|s| s.contains("the standard error of sigma_a.R")), "{factor}: {said:#?}");
    }
}

#[test]
fn a_changed_file_is_refused_and_another_program_is_said() {
    let copy = Copy::of("elm");
    copy.record(|record| record.program = "leaffit 3".into());
    let found = copy.faults();
    assert_eq!(found.all().count(), 0, "{found:#?}");
    assert!(found.notes[0].contains("leaffit 3, another program"), "{found:?}");
    found.require().unwrap();
    let path = copy.0.path().join("front_held_out.exr");
    let mut bytes = std::fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let said = copy.faults().require().unwrap_err().to_string();
    assert!(said.contains("front_held_out.exr: changed since it was fitted"), "{said}");
}

/// What the window saves is a fit of its own that agrees with itself, and is held to that.
#[test]
fn an_edited_fit_agrees_with_itself() {
    use crate::leaf_folder::edit::{LeafSideEdit, save};
    use mesophyll_optics::side::Sides;
    let edits = [
        LeafSideEdit { sigma_a: [1.5, 1.0, 0.7], ..LeafSideEdit::default() },
        LeafSideEdit { sigma_s: [0.8; 3], thickness_mm: 0.05, rho_s: 2.0, m: 0.5, ..LeafSideEdit::default() },
    ];
    for edit in edits {
        let dir = tempfile::tempdir().unwrap();
        let saved = save(&LeafFit::open(&committed("elm")).unwrap().edited(Sides::of(|_| edit)), dir.path()).unwrap();
        let found = of(&saved).unwrap();
        assert_eq!(found.all().count(), 0, "{found:#?}");
        let path = saved.join("front.exr");
        let mut maps = read_exr(&path).unwrap();
        maps.plane_mut(Quantity::RhoT, 1).unwrap().iter_mut().for_each(|v| *v *= 1.5);
        write_exr(&path, &maps, Packing::Zip).unwrap();
        let mut record = FitRecord::read(&saved).unwrap();
        record.files.insert("front.exr".into(), hash::file(&path).unwrap());
        record.write(&saved).unwrap();
        let found = of(&saved).unwrap();
        assert!(found.contradictions.iter().any(|s| s.contains("rho_t.G is not the transmittance")), "{found:#?}");
    }
}
