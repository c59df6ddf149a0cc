//! Extreme leaves. The verdict is `ok` where rays and the exact method agree within five standard errors, light is
//! conserved, and a closed form is met where one exists.

use crate::stress::StressRow;
use mesophyll_fits::foliar::surface::FoliarFitSetting;
use mesophyll_fits::foliar::{FoliarFitConstants, FoliarFitModel, FoliarParameter, FoliarReading};
use mesophyll_optics::foliar::pigments::{OpticalConstants, OpticalSpectrum};
use mesophyll_optics::foliar::{LayeredLeaf, LeafResponse, MesophyllPath, Oblateness, exact, walk};
use mesophyll_optics::side::Side;
use std::time::Instant;

const INF: f64 = f64::INFINITY;

/// A case: its name, the leaf, the lit side, the angle of incidence (degrees), the number of rays, and the right R and
/// T where they are known.
struct Case {
    name: &'static str,
    leaf: LayeredLeaf,
    side: Side,
    incidence: f64,
    rays: u64,
    known: Option<[f64; 2]>,
}

fn lobes(leaf: LayeredLeaf, epidermis: f64, palisade: f64, spongy: f64) -> LayeredLeaf {
    LayeredLeaf { oblateness: Oblateness { epidermis, palisade, spongy, ..leaf.oblateness }, ..leaf }
}

fn indices(leaf: LayeredLeaf, n_cuticle: f64, n_mesophyll: f64, n_antidermal: f64) -> LayeredLeaf {
    LayeredLeaf { n_cuticle, n_mesophyll, n_antidermal, ..leaf }
}

fn cases() -> Vec<Case> {
    let soybean = LayeredLeaf::soybean;
    let case = |name, leaf, side, incidence| Case { name, leaf, side, incidence, rays: 100_000, known: None };
    let (adaxial, abaxial) = (Side::Front, Side::Back);
    let black = |n: f64| indices(soybean(1e12), n, n, 1.42);
    let surface = |leaf: &LayeredLeaf, at: f64| Some([leaf.surface_reflectance(at.to_radians()), 0.0]);
    let air = indices(soybean(0.0), 1.0, 1.0, 1.0);
    vec![
        case("absorption 0", soybean(0.0), adaxial, 0.0),
        case("absorption 0, from below", soybean(0.0), abaxial, 60.0),
        case("absorption 1e-12", soybean(1e-12), adaxial, 30.0),
        case("absorption 1e-300", soybean(1e-300), adaxial, 30.0),
        Case { known: surface(&black(1.5), 30.0), ..case("absorption 1e12, one index", black(1.5), adaxial, 30.0) },
        case("absorption 1e300", soybean(1e300), abaxial, 30.0),
        Case { known: Some([0.0, 1.0]), ..case("all indices 1, absorption 0", air, adaxial, 45.0) },
        case("all indices 1", indices(soybean(0.3), 1.0, 1.0, 1.0), abaxial, 80.0),
        case("cuticle and mesophyll of one index", indices(soybean(0.3), 1.5, 1.5, 1.42), adaxial, 20.0),
        case("all indices 1.5", indices(soybean(0.3), 1.5, 1.5, 1.5), abaxial, 20.0),
        case("indices 1e-6 apart", indices(soybean(0.3), 1.5, 1.500_001, 1.499_999), adaxial, 20.0),
        case("indices 3, 1 and 3", indices(soybean(0.05), 3.0, 1.0, 3.0), adaxial, 50.0),
        case("indices 1, 3 and 1", indices(soybean(0.05), 1.0, 3.0, 1.0), abaxial, 50.0),
        case("wall of the highest index", indices(soybean(0.0), 1.3, 1.4, 3.0), abaxial, 70.0),
        case("grazing light, 89.9 degrees", soybean(0.3), adaxial, 89.9),
        case("grazing light, 89.9999 degrees, from below", soybean(0.3), abaxial, 89.9999),
        case("oblateness 0", lobes(soybean(0.3), 0.0, 0.0, 0.0), adaxial, 0.0),
        case("oblateness 0, clear, from below", lobes(soybean(0.0), 0.0, 0.0, 0.0), abaxial, 75.0),
        case("oblateness 1e-9", lobes(soybean(0.3), 1e-9, 1e-9, 1e-9), adaxial, 40.0),
        case("oblateness 300", lobes(soybean(0.3), 300.0, 300.0, 300.0), adaxial, 40.0),
        case("oblateness infinite", lobes(soybean(0.3), INF, INF, INF), abaxial, 40.0),
        case("oblateness infinite in the epidermis", lobes(soybean(0.3), INF, 1.0, 5.0), adaxial, 40.0),
        case("sieve and detour", LayeredLeaf { path: MesophyllPath::Sieve, ..soybean(0.4) }, adaxial, 10.0),
        Case { rays: 1, ..case("one ray", soybean(0.3), adaxial, 10.0) },
        Case { rays: 1_000_000, ..case("1e6 rays", soybean(0.3), abaxial, 10.0) },
    ]
}

/// Runs every case. 1e9 rays would take minutes, so their case only checks what could overflow.
pub fn rows() -> Vec<StressRow> {
    let mut rows: Vec<StressRow> = cases().iter().map(run).collect();
    rows.push(narrow());
    rows.push(many());
    rows.push(no_such_leaf());
    rows.extend(super::faults::rows());
    rows
}

/// A row of the table.
pub(super) fn row(name: &str, expected: &str, verdict: String, off: Option<f64>, clock: Instant) -> StressRow {
    StressRow {
        model: "foliar".into(),
        case: name.into(),
        expected: expected.into(),
        verdict,
        digits: off.map(|x| -x.clamp(1e-16, 1.0).log10()),
        condition: None,
        ms: clock.elapsed().as_secs_f64() * 1e3,
    }
}

fn run(case: &Case) -> StressRow {
    let (leaf, at) = (&case.leaf, case.incidence.to_radians());
    let clock = Instant::now();
    let Some(found) = exact::response(leaf, case.side, at) else {
        return row(case.name, "ok", "wrong: the exact method does not settle".into(), None, clock);
    };
    let counts = walk::count(leaf, case.side, at, case.rays, 1, &|| false);
    let LeafResponse { reflectance: r, transmittance: t } = found;
    let shares = [(counts.share(counts.reflected), r), (counts.share(counts.transmitted), t)];
    let far = shares.iter().map(|((share, error), want)| (share - want).abs() / error).fold(0.0, f64::max);
    let off = case.known.map(|[want_r, want_t]| (r - want_r).abs().max((t - want_t).abs()));
    let verdict = if !(far < 5.0) {
        format!("wrong: rays are {far:.1} standard errors from the exact {r} and {t}")
    } else if leaf.depth == 0.0 && (r + t - 1.0).abs() > 1e-9 {
        format!("wrong: {r} + {t} is not 1")
    } else if off.is_some_and(|off| off > 2e-5) {
        format!("wrong: {r} and {t} in place of {:?}", case.known)
    } else {
        "ok".into()
    };
    row(case.name, "ok", verdict, off, clock)
}

/// Lobes that are some thousandths of a degree wide act like no lobes.
fn narrow() -> StressRow {
    let clock = Instant::now();
    let (leaf, straight) =
        (lobes(LayeredLeaf::soybean(0.3), 1e9, 1e9, 1e9), lobes(LayeredLeaf::soybean(0.3), INF, INF, INF));
    let found = [leaf, straight].map(|leaf| exact::response(&leaf, Side::Front, 0.5));
    let [Some(found), Some(want)] = found else {
        return row("oblateness 1e9", "ok", "wrong: the exact method does not settle".into(), None, clock);
    };
    let off = (found.transmittance - want.transmittance).abs().max((found.reflectance - want.reflectance).abs());
    let verdict = if off < 2e-5 { "ok".into() } else { format!("wrong: {off:e} from straight light") };
    row("oblateness 1e9", "ok", verdict, Some(off), clock)
}

/// A fit of pigments to readings that no leaf gives: blue and red are reflected, green is let through.
fn no_such_leaf() -> StressRow {
    let clock = Instant::now();
    let of = |chlorophyll: f64, carotenoid: f64| OpticalConstants {
        specific: [chlorophyll, carotenoid, 10.0, 4.4, 1e-3],
        indices: [1.5, 1.42, 1.41],
    };
    let points = vec![(450.0, of(4.7e4, 5.1e4)), (550.0, of(1.2e4, 6e3)), (650.0, of(2.9e4, 3e3))];
    let lights: Vec<(f64, Side)> = points.iter().map(|p| (p.0, Side::Front)).collect();
    let setting =
        FoliarFitSetting { palisade: 1.0, spongy: 5.0, path: MesophyllPath::Sieve, incidence: 8f64.to_radians() };
    let asked = [FoliarParameter::Chlorophyll, FoliarParameter::Carotenoid, FoliarParameter::Oblateness];
    let known = FoliarFitConstants { contents: [0.0; 5], oblateness: 5.0 };
    let measured = [0.55, 0.03, 0.12, 0.45, 0.6, 0.12];
    let reading = |(k, value)| FoliarReading { light: k / 2, through: k % 2 == 1, value, err: f64::NAN };
    let readings: Vec<FoliarReading> = measured.into_iter().enumerate().map(reading).collect();
    let verdict = match FoliarFitModel::new(&OpticalSpectrum { points }, &lights, setting, &asked, Some(5e-3)) {
        Ok(model) => model.fit(&readings, &known).status.to_string(),
        Err(why) => why,
    };
    let names = asked.map(FoliarParameter::column).join("; ");
    let expected = format!("undetermined: {names} (the model does not describe this leaf");
    row("a leaf that cannot exist", &expected, verdict, None, clock)
}

/// Shares and errors of counts that exceed 32 bits.
fn many() -> StressRow {
    let clock = Instant::now();
    let counts = walk::RayCounts { rays: 10_000_000_000, reflected: 2_500_000_000, transmitted: 0, lost: 0 };
    let ((share, error), (none, of_none)) = (counts.share(counts.reflected), counts.share(0));
    let right = (share - 0.25).abs() < 1e-15 && (error * 1e5 / (0.1875f64).sqrt() - 1.0).abs() < 1e-6;
    let rest = none == 0.0 && (of_none * 1e10 - 1.0).abs() < 1e-3;
    let verdict = if right && rest { "ok".into() } else { format!("wrong: {share} ± {error}, {none} ± {of_none}") };
    row("counts of 1e10 rays", "ok", verdict, None, clock)
}
