//! What may be wrong with a whole scan, and what a device and its texels are under it.

use crate::record::scan::ScanRecord;
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::Travel;

/// How frames or photographs may have been coded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameCoding {
    /// The curve of sRGB (IEC 61966-2-1).
    Srgb,
    /// A power of 1/2.2.
    Gamma,
}

impl FrameCoding {
    /// The linear value of a coded one.
    pub fn linear(self, value: f64) -> f64 {
        match self {
            FrameCoding::Srgb if value <= 0.040_45 => value / 12.92,
            FrameCoding::Srgb => ((value + 0.055) / 1.055).powf(2.4),
            FrameCoding::Gamma => value.max(0.0).powf(2.2),
        }
    }

    /// Its name in a sentence.
    pub fn name(self) -> &'static str {
        match self {
            FrameCoding::Srgb => "sRGB",
            FrameCoding::Gamma => "a gamma of 2.2",
        }
    }
}

/// What could be wrong with a scan, and by how much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultCause {
    /// Nothing.
    None,
    /// `camera_deg` should be this.
    Camera(f64),
    /// `tube.height_mm`.
    Height(f64),
    /// `tube.length_mm`.
    Length(f64),
    /// `tube.radius_mm`.
    Radius(f64),
    /// `texel_mm`.
    Texel(f64),
    /// The tube of a pass stood this much farther (mm).
    Zero(Travel, f64),
    /// A constant of this size (calibrated) is in every reading.
    Offset(f64),
    /// The frames are coded.
    Coded(FrameCoding),
    /// The frames of these passes run the other way.
    Reversed(bool, bool),
    /// The frames of each pass are those of the other.
    Exchanged,
    /// Columns run the other way.
    Mirrored,
    /// The surface's lobe is another one.
    Surface(Lobe),
    /// The light changed evenly by this share.
    Drift(LightChange, f64),
    /// The light of a pass is this many times that of the other.
    Level(Travel, f64),
    /// From this frame on (counted over all passes) the leaf's picture lies this many columns to the right and rows
    /// upwards.
    Moved(usize, [f64; 2]),
}

/// When the light changed. It was, or came to be, the light of the other pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightChange {
    /// From the first frame of a pass on.
    After(Travel),
    /// Up to the last frame of a pass.
    Before(Travel),
    /// From the first frame of the first pass to the last of the last.
    Throughout,
}

impl LightChange {
    /// The light over what it should be. `at`: the frame within its pass, from 0 to 1; `before` passes of `passes` came
    /// earlier.
    fn light(self, change: f64, travel: Travel, at: f64, before: usize, passes: usize) -> f64 {
        match self {
            LightChange::After(pass) if pass == travel => 1.0 + change * at,
            LightChange::Before(pass) if pass == travel => 1.0 - change * (1.0 - at),
            LightChange::Throughout => 1.0 + change * (before as f64 + at) / passes as f64,
            _ => 1.0,
        }
    }
}

impl FaultCause {
    /// The light over what it should be, as [`LightChange::light`] has it; 1 where the cause has nothing to do with the
    /// lamp.
    pub fn light(self, travel: Travel, at: f64, before: usize, passes: usize) -> f64 {
        match self {
            FaultCause::Drift(when, change) => when.light(change, travel, at, before, passes),
            FaultCause::Level(pass, level) if pass == travel => level,
            _ => 1.0,
        }
    }
}

/// A cause whose amount is open, with a range of amounts to begin with; of a cause without an amount, one entry.
pub struct CauseFamily {
    pub of: Box<dyn Fn(f64) -> FaultCause>,
    pub grid: Vec<f64>,
}

impl CauseFamily {
    /// Amounts of a cause.
    pub fn of(of: fn(f64) -> FaultCause, grid: Vec<f64>) -> CauseFamily {
        CauseFamily { of: Box::new(of), grid }
    }

    /// A cause without an amount.
    pub fn one(cause: FaultCause) -> CauseFamily {
        CauseFamily { of: Box::new(move |_| cause), grid: vec![0.0] }
    }
}

/// The device under a cause.
pub fn device(scan: &ScanRecord, cause: FaultCause) -> ScanRecord {
    let mut scan = scan.clone();
    match cause {
        FaultCause::Camera(deg) => scan.camera_deg = deg,
        FaultCause::Height(mm) => scan.tube_height_mm = mm,
        FaultCause::Length(mm) => scan.tube_length_mm = mm,
        FaultCause::Radius(mm) => scan.tube_radius_mm = mm.min(0.9 * scan.tube_height_mm),
        FaultCause::Surface(lobe) => (scan.lobe, scan.lobe_index) = ScanRecord::name_lobe(lobe),
        _ => {}
    }
    scan
}

/// The place of a texel under a cause.
pub fn place(at: [f64; 2], cause: FaultCause, scan: &ScanRecord) -> [f64; 2] {
    match cause {
        FaultCause::Texel(mm) => at.map(|x| x * mm / scan.texel_mm),
        FaultCause::Mirrored => [-at[0], at[1]],
        _ => at,
    }
}
