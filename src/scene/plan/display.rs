//! From radiance to the displayed value, as the plan needs it to weigh a shortcut: exposure, Reinhard x/(1 + x), sRGB
//! encoding.

/// Displayed value (0 to 1) of a radiance at this exposure.
pub fn displayed(radiance: f64, exposure: f64) -> f64 {
    let x = (exposure * radiance).max(0.0);
    encode(x / (1.0 + x))
}

/// sRGB encoding (IEC 61966-2-1).
pub fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}
