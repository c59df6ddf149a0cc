//! What the trials and the white frames found, in sentences.

use super::causes::{FaultCause, FrameCoding, LightChange};
use super::trials::TrialOutcome;
use super::white_frames::{WhiteFrameFault, WhiteFrames};
use crate::record::fault::{FaultGrade, MeasurementFault};
use crate::record::scan::ScanRecord;
use mesophyll_capture::manifest::TubeManifest;
use mesophyll_optics::side::Side;

/// All that the traces under the tube are fitted for, and what follows from it.
const ALL: [&str; 7] = ["rho_d", "rho_s", "m", "normal", "sigma_a", "sigma_s", "gamma"];

/// Faults of the whole scan. Sides that show the same are named in one sentence.
pub fn faults(
    causes: &[(Side, TrialOutcome)],
    scan: &ScanRecord,
    m: &TubeManifest,
    whites: &WhiteFrames,
) -> Vec<MeasurementFault> {
    let mut out: Vec<MeasurementFault> = of_whites(whites, m, scan).into_iter().collect();
    let mut said: Vec<&str> = Vec::new();
    for (side, outcome) in causes {
        let Some(first) = outcome.causes.first() else { continue };
        let name = name(*first);
        if said.contains(&name) {
            continue;
        }
        said.push(name);
        let same: Vec<&(Side, TrialOutcome)> =
            causes.iter().filter(|c| c.1.causes.first().is_some_and(|f| self::name(*f) == name)).collect();
        let sides: Vec<String> = same.iter().map(|c| c.0.name().to_string()).collect();
        let whom = if sides.len() > 1 { "front and back".to_string() } else { side.name().to_string() };
        let list: Vec<String> = outcome.causes.iter().map(|c| sentence(*c, scan)).collect();
        let surface = matches!(first, FaultCause::Surface(_));
        out.push(MeasurementFault {
            name: name.into(),
            grade: if surface { FaultGrade::Doubtful } else { FaultGrade::Wrong },
            sides,
            spoils: ALL.map(String::from).to_vec(),
            says: format!(
                "{whom}: {}; the traces' reduced χ² is then {:.2} instead of {:.2}",
                list.join(", or "),
                outcome.after,
                outcome.before
            ),
        });
    }
    out
}

/// Traces that no cause explains.
pub fn unexplained(side: Side, outcome: &TrialOutcome) -> MeasurementFault {
    let side = side.name();
    MeasurementFault {
        name: "unexplained".into(),
        grade: FaultGrade::Doubtful,
        sides: vec![side.into()],
        spoils: Vec::new(),
        says: format!(
            "{side}: the traces' reduced χ² is {:.2} where their noise makes it {:.2}, and nothing that was tried \
             explains it (angle of the camera, height, length, radius and zero of the tube, size of a texel, dark \
             level, stray light, coding, order of the frames, drift, the lobes of `--lobe`); errors are widened by as \
             much",
            outcome.before, outcome.noise
        ),
    }
}

/// Name of the kind of fault.
fn name(cause: FaultCause) -> &'static str {
    match cause {
        FaultCause::None => "none",
        FaultCause::Camera(_) => "camera-angle",
        FaultCause::Height(_) => "tube-height",
        FaultCause::Length(_) => "tube-length",
        FaultCause::Radius(_) => "tube-radius",
        FaultCause::Texel(_) => "texel-size",
        FaultCause::Zero(..) => "tube-zero",
        FaultCause::Offset(_) => "stray-light",
        FaultCause::Coded(..) => "coded-frames",
        FaultCause::Reversed(..) => "pass-reversed",
        FaultCause::Exchanged => "passes-exchanged",
        FaultCause::Mirrored => "images-mirrored",
        FaultCause::Surface(_) => "lobe",
        FaultCause::Drift(..) => "drift",
        FaultCause::Level(..) => "pass-brightness",
        FaultCause::Moved(..) => "moved",
    }
}

fn sentence(cause: FaultCause, scan: &ScanRecord) -> String {
    match cause {
        FaultCause::None => "nothing".into(),
        FaultCause::Camera(deg) => format!(
            "the camera's angle is not as stated: the traces fit camera_deg = {deg:.1} and not {}",
            scan.camera_deg
        ),
        FaultCause::Height(mm) => format!(
            "the tube's height is not as stated: the traces fit tube.height_mm = {mm:.1} and not {}",
            scan.tube_height_mm
        ),
        FaultCause::Length(mm) => format!("the traces fit tube.length_mm = {mm:.0} and not {}", scan.tube_length_mm),
        FaultCause::Radius(mm) => format!("the traces fit tube.radius_mm = {mm:.1} and not {}", scan.tube_radius_mm),
        FaultCause::Texel(mm) => format!("the traces fit texel_mm = {mm:.3} and not {}", scan.texel_mm),
        FaultCause::Zero(travel, mm) => format!(
            "the tube's zero is off in pass {}: the traces fit start_mm and end_mm larger by {mm:+.1}",
            travel.name()
        ),
        FaultCause::Offset(a) if a > 0.0 => format!(
            "a constant light of {a:.4} lies in every reading (no dark.exr, light in the room, or light that the \
             leaf's surroundings send back)"
        ),
        FaultCause::Offset(a) => format!("{:.4} is missing in every reading (was the dark frame taken off twice?)", -a),
        FaultCause::Coded(coding) => format!("the frames are coded with {} and not linear in light", coding.name()),
        FaultCause::Reversed(x, y) => match (x, y) {
            (true, true) => "the frames of both passes run the other way (start_mm and end_mm exchanged)".into(),
            (true, false) => "the frames of pass x run the other way (start_mm and end_mm exchanged)".into(),
            _ => "the frames of pass y run the other way (start_mm and end_mm exchanged, or images upside down)".into(),
        },
        FaultCause::Exchanged => "the frames of pass x and pass y are exchanged".into(),
        FaultCause::Mirrored => "the images are mirrored (columns run the other way)".into(),
        FaultCause::Surface(lobe) => {
            let index = lobe.index().map_or(String::new(), |n| format!(" (index {n})"));
            format!("the surface scatters by another law: `--lobe {}`{index} explains the traces", lobe.name())
        }
        FaultCause::Drift(when, a) => format!(
            "the light {} by {:.0} % {}",
            if a > 0.0 { "grew" } else { "fell" },
            100.0 * a.abs(),
            match when {
                LightChange::Throughout =>
                    "from the first frame of the first pass to the last frame of the last".to_string(),
                LightChange::After(t) | LightChange::Before(t) =>
                    format!("from the first to the last frame of pass {}", t.name()),
            }
        ),
        FaultCause::Level(travel, g) => format!(
            "the light of pass {} is {g:.3} times that of the other pass (another exposure, or another lamp)",
            travel.name()
        ),
        FaultCause::Moved(frame, [right, up]) => {
            format!("the leaf's picture moves by {right:+.1} columns and {up:+.1} rows at frame {frame} of the scan")
        }
    }
}

fn of_whites(whites: &WhiteFrames, m: &TubeManifest, scan: &ScanRecord) -> Option<MeasurementFault> {
    let (first, _) = whites.causes.first()?;
    let name = match first {
        WhiteFrameFault::None => return None,
        WhiteFrameFault::Height(_) => "tube-height",
        WhiteFrameFault::Length(_) => "tube-length",
        WhiteFrameFault::Texel(_) => "texel-size",
        WhiteFrameFault::Dark(_) => "dark-level",
        WhiteFrameFault::Coded(_) => "coded-frames",
        WhiteFrameFault::Reversed(..) => "pass-reversed",
        WhiteFrameFault::Exchanged => "passes-exchanged",
    };
    let say = |amiss: &WhiteFrameFault| match amiss {
        WhiteFrameFault::None => String::new(),
        WhiteFrameFault::Height(mm) => format!("they fit tube.height_mm = {mm:.1} and not {}", scan.tube_height_mm),
        WhiteFrameFault::Length(mm) => format!("they fit tube.length_mm = {mm:.0} and not {}", scan.tube_length_mm),
        WhiteFrameFault::Texel(mm) => format!("they fit texel_mm = {mm:.3} and not {}", scan.texel_mm),
        WhiteFrameFault::Dark(b) if *b > 0.0 => format!(
            "a constant of {b:.4} lies in them (dark.exr is missing, or was taken with another exposure, or the room \
             was not dark)"
        ),
        WhiteFrameFault::Dark(b) => format!("{:.4} is missing in them (was the dark frame taken off twice?)", -b),
        WhiteFrameFault::Coded(coding) => {
            format!("they are coded with {} and not linear in light", FrameCoding::name(*coding))
        }
        WhiteFrameFault::Reversed(true, true) => "they run the other way (start_mm and end_mm exchanged)".into(),
        WhiteFrameFault::Reversed(x, _) => {
            format!("those of pass {} run the other way (start_mm and end_mm exchanged)", if *x { "x" } else { "y" })
        }
        WhiteFrameFault::Exchanged => "those of pass x and pass y are exchanged".into(),
    };
    let list: Vec<String> = whites.causes.iter().map(|(c, _)| say(c)).collect();
    Some(MeasurementFault {
        name: name.into(),
        grade: FaultGrade::Wrong,
        sides: m.sides.iter().map(|s| s.name().to_string()).collect(),
        spoils: ALL.map(String::from).to_vec(),
        says: format!(
            "white/: the white frames do not fall off as a tube's light does (by {:.1} %; then by {:.1} %): {}",
            100.0 * whites.scatter,
            100.0 * whites.causes.first().map_or(0.0, |c| c.1),
            list.join(", or ")
        ),
    })
}
