//! Plants in winds that are hard to draw: whether a pose keeps lengths, keeps children on their parents, and stays
//! finite; and whether broken files are refused.

use crate::stress::StressRow;
use glam::DVec3;
use mesophyll_fits::branch::beam::basis;
use mesophyll_plants::file;
use mesophyll_plants::form::{Branch, Joint, Plant};
use mesophyll_plants::growth::{grow, spec::PlantSpec};
use mesophyll_plants::mechanics::motion::MotionTexture;
use mesophyll_plants::mechanics::motion_spectrum::SpectrumMethod;
use mesophyll_plants::mechanics::wind::{Oscillator, Sway, Wind};
use mesophyll_plants::pose::RestPose;
use std::time::Instant;

/// Largest relative change of a length, and largest gap between child and parent relative to the parent's radius.
const MOST: f64 = 1e-3;
/// Number of branches on one trunk; every hundredth of them is checked.
const CHILDREN: usize = 10_000;

/// A bird cherry of three years.
fn sapling() -> Result<Plant, String> {
    let text = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/plants/bird-cherry-sapling.toml"));
    text.parse::<PlantSpec>().map(|spec| grow(&spec, None)).map_err(|e| e.to_string())
}

/// The largest change of a length and the largest gap in a posed plant, relative to what is allowed.
fn off(rest: &Plant, now: &Plant) -> f64 {
    let share = |(a, b): (&Branch, &Branch)| {
        let length = a.length();
        let stretched = if length > 0.0 { (b.length() / length - 1.0).abs() } else { b.length() };
        let gap = a.parent.map_or(0.0, |joint| {
            let of =
                |plant: &Plant, child: &Branch| plant.branches[joint.branch].point(joint.at).0.distance(child.root);
            let radius = rest.branches[joint.branch].radius(joint.at).max(1e-3);
            (of(now, b) - of(rest, a)).abs() / radius
        });
        // A number that is not finite must fail.
        let worst = if stretched.is_nan() || gap.is_nan() { f64::INFINITY } else { stretched.max(gap) };
        worst / MOST
    };
    let step = if rest.branches.len() > 1000 { 100 } else { 1 };
    rest.branches.iter().zip(&now.branches).step_by(step).map(share).fold(0.0, f64::max)
}

/// A row for a plant whose tips move by `tip` of their length, each branch in another direction.
fn posed(case: &str, plant: &Plant, tip: f64) -> StressRow {
    let clock = Instant::now();
    let limbs = RestPose::new(plant, basis::shape);
    let amplitude = |k: usize| {
        let (sin, cos) = (0.7 + 1.3 * k as f64).sin_cos();
        [sin, cos].map(|c| c * tip / limbs.0[k].tip)
    };
    let now = limbs.pose(amplitude).plant(plant);
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    let off = off(plant, &now);
    let still = tip > 0.0 || now == *plant;
    let verdict = match (off <= 1.0, still) {
        (true, true) => "ok".into(),
        (_, false) => "wrong: a plant at rest moved".to_string(),
        (false, _) => format!("wrong: a length or a gap is {off:.1} times as far off as it may be"),
    };
    row(case, "ok", verdict, Some(-(MOST * off).max(1e-16).log10()), ms)
}

fn row(case: &str, expected: &str, verdict: String, digits: Option<f64>, ms: f64) -> StressRow {
    StressRow {
        model: "wind".into(),
        case: case.into(),
        expected: expected.into(),
        verdict,
        digits,
        condition: None,
        ms,
    }
}

/// A trunk with very many branches.
fn brush(sapling: &Plant) -> Plant {
    let trunk = sapling.branches[0].clone();
    let mut plant = Plant { name: "brush".into(), branches: vec![trunk.clone()], ..Plant::default() };
    plant.branches.extend((0..CHILDREN).map(|k| {
        let at = (k as f64 + 0.5) / CHILDREN as f64;
        Branch {
            name: format!("1.{k}"),
            parent: Some(Joint { branch: 0, at }),
            level: 1,
            root: trunk.point(at).0,
            axis: vec![DVec3::ZERO, DVec3::new(40.0, 0.0, 0.0)],
            root_radius: 1.0,
            tip_radius: 0.5,
            wood: Default::default(),
            ..trunk.clone()
        }
    }));
    plant
}

/// Gusts of a branch over ten minutes from a given time, second by second. They must be finite and have the variance of
/// the spectrum (to 30 %, about four standard deviations for this many readings), and none may exceed six standard
/// deviations.
fn gusts(case: &str, start: f64) -> StressRow {
    let clock = Instant::now();
    let oscillator = Oscillator::of_branch(1.0, false, 0.15);
    let sway = Sway { wind: Wind { speed: 8.0, turbulence: 0.3 }, oscillator, lean: 1.0 };
    let verdict = match MotionTexture::new(|f| sway.spectrum(f), sway.highest(), 256, 5, SpectrumMethod::Directed) {
        None => "wrong: no motion".to_string(),
        Some(motion) => {
            let line = motion.trajectory(3, 1.0);
            let seen: Vec<f64> = (0..600).flat_map(|k| motion.sample(line.at(start + f64::from(k)))).collect();
            let largest = seen.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
            let variance = seen.iter().map(|v| v * v).sum::<f64>() / seen.len() as f64;
            // The spectrum in small steps, from the lowest frequencies that ten minutes contain.
            let step = sway.highest() / 50_000.0;
            let wanted: f64 = (0..50_000).map(|k| sway.spectrum((f64::from(k) + 0.5) * step) * step).sum();
            let off = variance / wanted - 1.0;
            match off.abs() <= 0.3 && largest <= 6.0 * wanted.sqrt() {
                true => "ok".into(),
                false => format!("wrong: the variance is off by {off:.2}, the largest gust is {largest:.2e}"),
            }
        }
    };
    row(case, "ok", verdict, None, clock.elapsed().as_secs_f64() * 1e3)
}

/// The result of reading a file with these nodes.
fn read(case: &str, expected: &str, nodes: &str) -> StressRow {
    let clock = Instant::now();
    let text = format!(r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{nodes}]}}"#);
    let told = || -> Result<String, String> {
        let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
        let path = folder.path().join("plant.gltf");
        std::fs::write(&path, &text).map_err(|e| e.to_string())?;
        Ok(match file::read(&path) {
            Ok(plant) => format!("ok, {} branches", plant.branches.len()),
            Err(e) => format!("refused: {}", e.to_string().replace(&path.display().to_string(), "plant.gltf")),
        })
    };
    let verdict = told().unwrap_or_else(|e| format!("wrong: {e}"));
    row(case, expected, verdict, None, clock.elapsed().as_secs_f64() * 1e3)
}

/// The cases of `stress wind`.
///
/// # Errors
/// [`crate::Error::Missed`] where the sapling that is bent is not a plant.
pub fn rows() -> crate::Result<Vec<StressRow>> {
    let plant = sapling().map_err(crate::Error::Missed)?;
    let mut out = vec![
        posed("no wind", &plant, 0.0),
        posed("a breeze: tips go by a twentieth of the length", &plant, 0.05),
        posed("a storm: tips go by .8 of the length", &plant, 0.8),
        posed("more than any wind: thirty times the length", &plant, 30.0),
    ];
    for (case, taper) in
        [("tips without thickness", 0.0), ("branches that do not taper", 1.0), ("tips thicker than roots", 2.0)]
    {
        let mut of = plant.clone();
        of.branches.iter_mut().for_each(|b| b.tip_radius = taper * b.root_radius);
        out.push(posed(case, &of, 0.6));
    }
    let mut stump = plant.clone();
    let last = stump.branches.len() - 1;
    stump.branches[last].axis = vec![DVec3::ZERO; 2];
    stump.branches[last].wood = Default::default();
    stump.leaves.retain(|leaf| leaf.joint.branch != last);
    out.push(posed("a branch without length", &stump, 0.6));
    out.push(posed("ten thousand branches on a trunk, in a breeze", &brush(&plant), 0.02));
    out.push(gusts("steps of a second", 0.0));
    out.push(gusts("after a million seconds", 1e6));
    let branch = |name: &str, children: &str| {
        format!(
            r#"{{"name":"{name}","children":[{children}],
                "extras":{{"branch":{{"level":0,"length_mm":100,"root_radius_mm":3,"tip_radius_mm":1}}}}}}"#
        )
    };
    let two = [branch("a", "1"), branch("b", "0")].join(",");
    out.push(read("a file in which two branches grow on each other", "refused", &two));
    let same =
        [r#"{"children":[1,2]}"#.into(), branch("a", ""), branch("a", "")].join(",").replace(r#""children":[],"#, "");
    out.push(read("a file with two branches of one name", "refused", &same));
    let roots =
        [r#"{"children":[1,2]}"#.into(), branch("a", ""), branch("b", "")].join(",").replace(r#""children":[],"#, "");
    // Shrubs may have several trunks.
    out.push(read("a file with two trunks", "ok, 2 branches", &roots));
    Ok(out)
}
