//! `fits/` contains what the program makes of `data/`. Its leaves are scanned and fitted again (as `make fits` does)
//! and compared with the committed files.
//!
//! On the same kind of machine the bytes agree. On another kind the C library may round an exponential in the other
//! direction. Then numbers may differ by a fiftieth of their own standard errors. That is far less than a change of a
//! model, a convention or a seed would cause.

use mesophyll::files::image::{ChannelMaps, Packing, read_exr, write_exr};
use mesophyll::files::quantity::Quantity;
use mesophyll::fits::record::FitRecord;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::{fits::maker, ledger::Ledger};
use std::path::Path;

/// Largest allowed difference of a value, as a share of its standard error.
const SHARE: f32 = 0.02;

/// Scans and fits leaf `name` of `data/scenes/fits.toml` in a folder of its own, and compares.
fn made_anew(name: &str) {
    let manifest = SceneManifest::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("data/scenes/fits.toml")).unwrap();
    let index = manifest.leaf_index(name).unwrap();
    let committed = manifest.resolve(manifest.leaves[index].fit().unwrap().fit.as_ref().unwrap());
    FitRecord::read(&committed).unwrap().verify(&committed).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let fresh = dir.path().join("fit");
    maker::fit(&manifest, index, dir.path(), &fresh, false, &Ledger::new()).unwrap();
    let differing = compare(&committed, &fresh);
    println!(
        "{name}: {}",
        if differing.is_empty() {
            "byte for byte".into()
        } else {
            format!("{} within tolerance", differing.join(", "))
        }
    );
}

/// Compares `fresh` with `committed`. Returns the names of files that agree, but not in every byte.
fn compare(committed: &Path, fresh: &Path) -> Vec<String> {
    assert_eq!(names(committed), names(fresh), "{}: other files than a fit writes", committed.display());
    let differing: Vec<String> = names(fresh)
        .into_iter()
        .filter(|n| std::fs::read(committed.join(n)).unwrap() != std::fs::read(fresh.join(n)).unwrap())
        .collect();
    for name in differing.iter().filter(|n| n.ends_with(".exr")) {
        close_maps(committed, fresh, name);
    }
    if !differing.is_empty() {
        close_numbers(committed, fresh);
    }
    differing
}

/// The committed files of a fit: all except its times and its copy of a synthetic scan's truth, which the scan can make
/// again.
fn names(folder: &Path) -> Vec<String> {
    let files = std::fs::read_dir(folder).unwrap().flatten().map(|e| e.file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> = files.filter(|n| n != "times.toml" && !n.ends_with("_truth.exr")).collect();
    names.sort();
    names
}

fn close_maps(committed: &Path, fresh: &Path, name: &str) {
    let [old, new] = [committed, fresh].map(|f| read_exr(&f.join(name)).unwrap());
    let stem = name.trim_end_matches(".exr");
    let (side, what) = stem.split_once('_').unwrap_or((stem, ""));
    let errors = read_exr(&fresh.join(format!("{side}_err.exr"))).unwrap();
    let mask = read_exr(&fresh.join(format!("{side}.exr"))).unwrap();
    let good: Vec<bool> = mask.scalar(Quantity::Mask).unwrap().iter().map(|m| *m == 1.0).collect();
    let channels = |m: &ChannelMaps| m.channels.iter().map(|c| c.0.clone()).collect::<Vec<_>>();
    assert_eq!((old.width, old.height, channels(&old)), (new.width, new.height, channels(&new)), "{name}");
    for ((channel, a), (_, b)) in old.channels.iter().zip(&new.channels) {
        let error = if what == "err" { None } else { errors.get(channel) };
        let mut worst = (0, 0f32);
        for k in (0..a.len()).filter(|&k| good[k] && a[k] != b[k] && !(a[k].is_nan() && b[k].is_nan())) {
            let allowed = match error {
                Some(e) if e[k].is_finite() => SHARE * e[k] + 1e-6 * b[k].abs(),
                _ if channel == "mask.Y" => 0.0,
                _ => 0.01 * b[k].abs(),
            };
            let ratio = (a[k] - b[k]).abs() / allowed;
            if !(ratio <= worst.1) {
                worst = (k, ratio);
            }
        }
        let (k, ratio) = worst;
        let place = [k % old.width, k / old.width];
        assert!(
            ratio <= 1.0,
            "{}: {channel} at {place:?} is {}, made anew it is {} ({ratio:.1} times what is allowed); `make fits` \
             makes it anew",
            committed.join(name).display(),
            a[k],
            b[k]
        );
    }
}

/// Parameters, counts and figures of both records.
fn close_numbers(committed: &Path, fresh: &Path) {
    let [old, new] = [committed, fresh].map(|f| FitRecord::read(f).unwrap());
    assert_eq!((&old.kind, &old.name, &old.defects), (&new.kind, &new.name, &new.defects));
    assert_eq!(old.options.keys().collect::<Vec<_>>(), new.options.keys().collect::<Vec<_>>());
    assert_eq!(old.sections.keys().collect::<Vec<_>>(), new.sections.keys().collect::<Vec<_>>());
    for (side, b) in &new.sections {
        let a = &old.sections[side];
        assert_eq!(a.params.keys().collect::<Vec<_>>(), b.params.keys().collect::<Vec<_>>(), "{side}");
        for (name, p) in &b.params {
            for (k, value) in p.value.iter().enumerate() {
                let allowed = if p.stderr[k].is_finite() { f64::from(SHARE) * p.stderr[k] } else { 0.0 };
                let found = a.params[name].value[k];
                assert!(
                    (found - value).abs() <= allowed,
                    "{side}.{name}: {found}, made anew {value} ± {}",
                    p.stderr[k]
                );
            }
        }
        for (name, value) in b.figures.iter().filter(|(n, _)| n.starts_with("blade_")) {
            assert!((a.figures[name] / value - 1.0).abs() < 1e-3, "{name}: {}, made anew {value}", a.figures[name]);
        }
        for (name, count) in &b.counts {
            assert!(
                a.counts[name].abs_diff(*count) * 1000 <= b.counts["texels"],
                "{side}: {name}: {}, made anew {count}",
                a.counts[name]
            );
        }
        for (name, r) in &b.residuals {
            let found = a.residuals[name].reduced_chi2;
            assert!(
                (found / r.reduced_chi2 - 1.0).abs() < 1e-3,
                "{side}: {name}: χ² {found}, made anew {}",
                r.reduced_chi2
            );
        }
        for (name, t) in &b.truth {
            let found = a.truth[name].p99_relative;
            assert!(
                (found / t.p99_relative - 1.0).abs() < 0.02,
                "{side}: {name}: error to the truth {found}, made anew {}",
                t.p99_relative
            );
        }
    }
}

/// Tests the comparison itself. A difference of a twentieth of the tolerance passes. Five times the tolerance fails,
/// and so does another number in `fit.toml`.
#[test]
fn a_change_of_a_tenth_of_a_standard_error_is_seen() {
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("fits/elm");
    let dir = tempfile::tempdir().unwrap();
    let changed = |how: &dyn Fn(&Path)| {
        let _ = std::fs::remove_dir_all(dir.path().join("copy"));
        let copy = dir.path().join("copy");
        std::fs::create_dir(&copy).unwrap();
        for name in names(&committed) {
            std::fs::copy(committed.join(&name), copy.join(&name)).unwrap();
        }
        how(&copy);
        std::panic::catch_unwind(|| compare(&committed, &copy)).is_err()
    };
    let shift = |share: f32| {
        move |folder: &Path| {
            let errors = read_exr(&folder.join("front_err.exr")).unwrap();
            let mut maps = read_exr(&folder.join("front.exr")).unwrap();
            let at = maps.channels.iter().position(|c| c.0 == "rho_d.G").unwrap();
            let k = maps.scalar(Quantity::Mask).unwrap().iter().rposition(|m| *m == 1.0).unwrap();
            maps.channels[at].1[k] += share * errors.plane(Quantity::RhoD, 1).unwrap()[k];
            write_exr(&folder.join("front.exr"), &maps, Packing::Zip).unwrap();
        }
    };
    assert!(!changed(&|_| {}) && !changed(&shift(0.05 * SHARE)));
    assert!(changed(&shift(5.0 * SHARE)));
    assert!(changed(&|folder: &Path| {
        let mut record = FitRecord::read(folder).unwrap();
        let sigma = record.sections.get_mut("front").unwrap().params.get_mut("sigma_a").unwrap();
        sigma.value[1] += 0.1 * sigma.stderr[1];
        record.write(folder).unwrap();
    }));
    assert!(changed(&|folder: &Path| std::fs::remove_file(folder.join("back.exr")).unwrap()));
}

#[test]
fn elm_is_what_the_program_makes() {
    made_anew("elm");
}

#[test]
fn balata_is_what_the_program_makes() {
    made_anew("balata");
}
