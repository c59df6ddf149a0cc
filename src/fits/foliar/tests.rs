use super::*;
use mesophyll_files::table::{InputTable, TableRecord};
use mesophyll_optics::foliar::{LayeredLeaf, MesophyllPath, Oblateness, exact};
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::LazyLock;

const SETTING: FoliarFitSetting =
    FoliarFitSetting { palisade: 1.0, spongy: 5.0, path: MesophyllPath::Sieve, incidence: 0.14 };
const KNOWN: FoliarFitConstants = FoliarFitConstants { contents: [0.0; 5], oblateness: 5.0 };
const THREE: [FoliarParameter; 3] =
    [FoliarParameter::Chlorophyll, FoliarParameter::Carotenoid, FoliarParameter::Oblateness];

/// Constants of the size of a leaf's at three wavelengths; made up, so that no database is needed.
fn spectrum() -> OpticalSpectrum {
    let of = |chlorophyll: f64, carotenoid: f64, n: f64| OpticalConstants {
        specific: [chlorophyll, carotenoid, 10.0, 4.0, 1e-3],
        indices: [n, 1.42, 1.41],
    };
    let points = vec![(450.0, of(5e4, 5e4, 1.53)), (550.0, of(1.2e4, 6e3, 1.51)), (650.0, of(3e4, 0.0, 1.5))];
    OpticalSpectrum { points }
}

/// Readings of a leaf as the exact method computes them.
fn readings(lights: &[(f64, Side)], chlorophyll: f64, carotenoid: f64, epidermis: f64) -> Vec<FoliarReading> {
    of_spectrum(&spectrum(), lights, chlorophyll, carotenoid, epidermis)
}

fn of_spectrum(
    spectrum: &OpticalSpectrum,
    lights: &[(f64, Side)],
    chlorophyll: f64,
    carotenoid: f64,
    epidermis: f64,
) -> Vec<FoliarReading> {
    let mut readings = Vec::new();
    for (light, &(wavelength, side)) in lights.iter().enumerate() {
        let constants = spectrum.at(wavelength).unwrap();
        let per = constants.per_content();
        let [n_cuticle, n_mesophyll, n_antidermal] = constants.indices;
        let leaf = LayeredLeaf {
            depth: per[0] * chlorophyll + per[1] * carotenoid,
            n_cuticle,
            n_mesophyll,
            n_antidermal,
            oblateness: Oblateness { epidermis, ..Oblateness::USUAL },
            path: SETTING.path,
        };
        let found = exact::response(&leaf, side, SETTING.incidence).unwrap();
        for (through, value) in [(false, found.reflectance), (true, found.transmittance)] {
            readings.push(FoliarReading { light, through, value, err: f64::NAN });
        }
    }
    readings
}

const LIGHTS: [(f64, Side); 3] = [(450.0, Side::Front), (550.0, Side::Front), (650.0, Side::Front)];

/// What all tests of the same lights share.
static MODEL: LazyLock<FoliarFitModel> =
    LazyLock::new(|| FoliarFitModel::new(&spectrum(), &LIGHTS, SETTING, &THREE, None).unwrap());

#[test]
fn what_a_leaf_was_made_of_is_found() {
    let model = MODEL.asking(&THREE, Some(1e-3));
    for (chlorophyll, carotenoid, epidermis) in [(30.0, 8.0, 5.0), (12.0, 3.0, 2.0), (45.0, 6.0, 9.0)] {
        let found = model.fit(&readings(&LIGHTS, chlorophyll, carotenoid, epidermis), &KNOWN);
        for (k, truth) in [chlorophyll, carotenoid, epidermis].into_iter().enumerate() {
            let (value, error) = (found.values[k], found.values[3 + k]);
            // The readings have no noise: the only error left is that of interpolation between the nodes.
            assert!((value - truth).abs() < 0.3 * error, "{truth}: {found:?}");
        }
        assert!(found.values[6] < 1e-4, "{found:?}");
    }
}

/// The stated standard errors agree with the scatter of fits to noisy readings.
#[test]
fn standard_errors_are_true() {
    use rand::{RngExt, SeedableRng};
    let noise = 2e-3;
    let model = MODEL.asking(&THREE, Some(noise));
    let clean = readings(&LIGHTS, 30.0, 8.0, 5.0);
    let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
    let runs = 100;
    let mut squares = [0.0; 3];
    for _ in 0..runs {
        let noisy: Vec<FoliarReading> = clean
            .iter()
            .map(|r| {
                // The sum of twelve uniform numbers is close enough to normal.
                let z: f64 = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                FoliarReading { value: r.value + noise * z, ..*r }
            })
            .collect();
        let found = model.fit(&noisy, &KNOWN);
        for (k, truth) in [30.0, 8.0, 5.0].into_iter().enumerate() {
            squares[k] += ((found.values[k] - truth) / found.values[3 + k]).powi(2);
        }
    }
    for (k, s) in squares.iter().enumerate() {
        let chi2 = s / f64::from(runs);
        // The limit is four standard deviations of χ², plus a tenth for what is not linear.
        assert!((chi2 - 1.0).abs() < 4.0 * (2.0 / f64::from(runs)).sqrt() + 0.1, "{k}: {chi2}");
    }
}

#[test]
fn what_readings_do_not_tell_is_named() {
    let asked = [
        FoliarParameter::Chlorophyll,
        FoliarParameter::Carotenoid,
        FoliarParameter::Oblateness,
        FoliarParameter::Thickness,
    ];
    let model = MODEL.asking(&asked, Some(1e-3));
    let all = readings(&LIGHTS, 30.0, 8.0, 5.0);
    let Status::Undetermined(what) = model.fit(&all, &KNOWN).status else { panic!("a thickness was found") };
    assert!(what.starts_with("mesophyll_thickness_mm") && !what.contains("chlorophyll"), "{what}");
    // One wavelength tells only a sum of pigments, and the lobe.
    let model = MODEL.asking(&THREE, Some(1e-3));
    let one = model.fit(&all[2..4], &KNOWN).status;
    assert!(one.leaves_open("chlorophyll_ug_cm2") && one.leaves_open("carotenoid_ug_cm2"), "{one}");
    assert!(!one.leaves_open("oblateness_epidermis"), "{one}");
    // The third wavelength shows chlorophyll alone.
    let red = model.fit(&all[4..], &KNOWN).status;
    assert!(red.leaves_open("carotenoid_ug_cm2") && !red.leaves_open("chlorophyll_ug_cm2"), "{red}");
    assert!(matches!(model.fit(&[], &KNOWN).status, Status::Refused(_)));
    let wild = [FoliarReading { value: 1.5, ..all[0] }];
    assert!(model.fit(&wild, &KNOWN).status.to_string().contains("reflectance at 450 nm is 1.5"));
    assert!(FoliarFitModel::new(&spectrum(), &[(300.0, Side::Front)], SETTING, &THREE, None).is_err());
}

#[test]
fn errors_are_claimed_only_where_noise_is_stated() {
    let all = readings(&LIGHTS, 30.0, 8.0, 5.0);
    let with = |noise: Option<f64>| MODEL.asking(&THREE, noise).fit(&all, &KNOWN);
    let (unstated, exact) = (with(None), with(Some(0.0)));
    assert!(unstated.values[3..6].iter().all(|e| e.is_nan()) && unstated.status == Status::Ok, "{unstated:?}");
    assert!(exact.values[3..6].iter().all(|e| *e == 0.0), "{exact:?}");
}

/// LOPEX93 and ANGERS at 450, 550 and 650 nm, with three fitted parameters a leaf. PROSPECT-D with three parameters
/// leaves an error of .0132.
#[test]
fn real_leaves_are_fitted_as_closely_as_by_prospect() {
    let Some(data) = std::env::var_os("MESOPHYLL_DATA").map(PathBuf::from) else {
        println!("skipped: MESOPHYLL_DATA names no folder of measured leaves");
        return;
    };
    let spectrum = pigments::read(&data.join("foliar/pigments_npsg.csv")).unwrap();
    let model = FoliarFitModel::new(&spectrum, &LIGHTS, SETTING, &THREE, None).unwrap();
    let mut leaves: Vec<Vec<FoliarReading>> = Vec::new();
    for file in ["leaves/reflectance_transmittance.csv", "leaves/reflectance_transmittance_2.csv"] {
        let mut table = InputTable::open(&data.join(file)).unwrap();
        let places: Vec<usize> =
            ["R450", "T450", "R550", "T550", "R650", "T650"].iter().map(|c| table.require(c).unwrap()).collect();
        let mut record = TableRecord::default();
        while table.next_record(&mut record).unwrap() {
            let read = |(k, &place): (usize, &usize)| {
                let value = record.text(Some(place))?.ok()?.parse().ok()?;
                Some(FoliarReading { light: k / 2, through: k % 2 == 1, value, err: f64::NAN })
            };
            leaves.push(places.iter().enumerate().filter_map(read).collect());
        }
    }
    let count = leaves.iter().map(Vec::len).sum::<usize>() as f64;
    let squares: f64 = leaves.par_iter().map(|l| model.fit(l, &KNOWN).values[6].powi(2) * l.len() as f64).sum();
    let leaves = leaves.len();
    let rms = (squares / count).sqrt();
    println!("{leaves} leaves, {count} readings: rms {rms:.4}");
    assert!(leaves > 600 && rms <= 0.0135, "{leaves} leaves: {rms}");
}

/// A leaf whose readings no pigments give, and a leaf with a wave over wavelength that its stated noise would hide.
#[test]
fn what_the_layered_leaf_does_not_describe_is_never_ok() {
    let model = MODEL.asking(&THREE, Some(5e-3));
    let mut odd = readings(&LIGHTS, 30.0, 8.0, 5.0);
    // Blue is reflected, green let through and red reflected: the two bands of chlorophyll contradict each other.
    for (reading, value) in odd.iter_mut().zip([0.55, 0.03, 0.12, 0.45, 0.6, 0.12]) {
        reading.value = value;
    }
    for noise in [Some(5e-3), None, Some(0.0)] {
        let found = model.asking(&THREE, noise).fit(&odd, &KNOWN);
        let said = found.status.to_string();
        assert!(THREE.iter().all(|p| found.status.leaves_open(p.column())), "{said}");
        assert!(said.contains("the model does not describe this leaf: "), "{said}");
    }

    let lights: Vec<(f64, Side)> = (0..40).map(|k| (450.0 + 5.0 * f64::from(k), Side::Front)).collect();
    let mut flat = spectrum();
    flat.points.iter_mut().for_each(|p| p.1.indices = [1.5, 1.42, 1.41]);
    let model = FoliarFitModel::new(&flat, &lights, SETTING, &THREE, Some(4e-3)).unwrap();
    let clean = of_spectrum(&flat, &lights, 30.0, 8.0, 5.0);
    let with = |wave: f64| {
        let moved = |(k, r): (usize, &FoliarReading)| {
            let parity = if (k / 2) % 2 == 0 { 1.0 } else { -1.0 };
            let slow = (f64::from(k as u32) / 6.0).sin();
            FoliarReading { value: r.value + 4e-3 * (wave * slow + (1.0 - wave) * parity), ..*r }
        };
        model.fit(&clean.iter().enumerate().map(moved).collect::<Vec<_>>(), &KNOWN)
    };
    let (rough, wavy) = (with(0.0), with(1.0));
    assert_eq!(rough.status, Status::Ok, "{rough:?}");
    assert!(wavy.status.to_string().contains("along the wavelength"), "{wavy:?}");
    assert!(wavy.values[3] > 1.5 * rough.values[3], "errors are widened: {wavy:?} {rough:?}");
}
