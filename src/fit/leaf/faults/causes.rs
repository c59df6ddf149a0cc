//! What may be wrong with a whole scan, and what a device and its texels are under it.

use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::Travel;
use mesophyll_record::scan::Scan;

/// How frames or photographs may have been coded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Coding {
    /// The curve of sRGB (IEC 61966-2-1).
    Srgb,
    /// A power of 1/2.2.
    Gamma,
}

impl Coding {
    /// The linear value of a coded one.
    pub fn linear(self, value: f64) -> f64 {
        match self {
            Coding::Srgb if value <= 0.040_45 => value / 12.92,
            Coding::Srgb => ((value + 0.055) / 1.055).powf(2.4),
            Coding::Gamma => value.max(0.0).powf(2.2),
        }
    }

    /// Its name in a sentence.
    pub fn name(self) -> &'static str {
        match self {
            Coding::Srgb => "sRGB",
            Coding::Gamma => "a gamma of 2.2",
        }
    }
}

/// What could be wrong with a scan, and by how much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cause {
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
    Coded(Coding),
    /// The frames of these passes run the other way.
    Reversed(bool, bool),
    /// The frames of each pass are those of the other.
    Exchanged,
    /// Columns run the other way.
    Mirrored,
    /// The surface's lobe is another one.
    Surface(Lobe),
    /// The light changed evenly by this share over the pass x, y, or both.
    Drift(Option<Travel>, f64),
}

/// A cause whose amount is open, with a range of amounts to begin with; of a cause without an amount, one entry.
pub struct Family {
    pub of: Box<dyn Fn(f64) -> Cause>,
    pub grid: Vec<f64>,
}

impl Family {
    /// Amounts of a cause.
    pub fn of(of: fn(f64) -> Cause, grid: Vec<f64>) -> Family {
        Family { of: Box::new(of), grid }
    }

    /// A cause without an amount.
    pub fn one(cause: Cause) -> Family {
        Family { of: Box::new(move |_| cause), grid: vec![0.0] }
    }
}

/// The device under a cause.
pub fn device(scan: &Scan, cause: Cause) -> Scan {
    let mut scan = scan.clone();
    match cause {
        Cause::Camera(deg) => scan.camera_deg = deg,
        Cause::Height(mm) => scan.tube_height_mm = mm,
        Cause::Length(mm) => scan.tube_length_mm = mm,
        Cause::Radius(mm) => scan.tube_radius_mm = mm.min(0.9 * scan.tube_height_mm),
        Cause::Surface(lobe) => (scan.lobe, scan.lobe_index) = Scan::name_lobe(lobe),
        _ => {}
    }
    scan
}

/// The place of a texel under a cause.
pub fn place(at: [f64; 2], cause: Cause, scan: &Scan) -> [f64; 2] {
    match cause {
        Cause::Texel(mm) => at.map(|x| x * mm / scan.texel_mm),
        Cause::Mirrored => [-at[0], at[1]],
        _ => at,
    }
}
