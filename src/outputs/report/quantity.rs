//! The quantities that a fit writes as maps: their names in words, their units, and how they are drawn.

use mesophyll_files::quantity::split;

/// A known quantity.
#[derive(Debug, Clone, Copy)]
pub struct MapQuantity {
    /// The name in channels and parameters.
    pub name: &'static str,
    /// Symbol and name in words.
    pub title: &'static str,
    pub unit: &'static str,
    /// Whether zero is the middle of the scale; ratios then mean nothing.
    pub signed: bool,
}

/// In the order of the report.
pub(crate) const QUANTITIES: [MapQuantity; 9] = [
    MapQuantity { name: "rho_d", title: "ρd, diffuse reflectance", unit: "", signed: false },
    MapQuantity { name: "rho_t", title: "ρt, transmittance", unit: "", signed: false },
    MapQuantity { name: "rho_s", title: "ρs, specular reflectance", unit: "", signed: false },
    MapQuantity { name: "m", title: "m, roughness (RMS slope)", unit: "", signed: false },
    MapQuantity { name: "normal", title: "Normal", unit: "", signed: true },
    MapQuantity { name: "thickness", title: "h + δ, thickness", unit: "mm", signed: false },
    MapQuantity { name: "gamma", title: "γ, reflectance over that of the mean slab", unit: "", signed: false },
    MapQuantity { name: "sigma_a", title: "σa, absorption", unit: "1/mm", signed: false },
    MapQuantity { name: "sigma_s", title: "σs, scattering", unit: "1/mm", signed: false },
];

/// Channels that are shown elsewhere, or (z of a unit normal) not at all.
pub(crate) const SET_APART: [&str; 3] = ["mask.Y", "reduced_chi2.Y", "normal.Z"];

pub fn known(name: &str) -> Option<&'static MapQuantity> {
    QUANTITIES.iter().find(|q| q.name == name)
}

/// `σa` for `sigma_a`; the name itself where there is no symbol.
pub(crate) fn symbol(name: &str) -> String {
    if let Some(own) = name.strip_suffix("_map") {
        return format!("{} maps", symbol(own));
    }
    let other = || PARAMETERS.iter().find(|p| p.0 == name).map_or(name, |p| p.1);
    known(name).filter(|q| q.name != "normal").and_then(|q| q.title.split(',').next()).unwrap_or_else(other).to_string()
}

/// Parameters that are not maps: name in `fit.toml`, symbol, meaning.
const PARAMETERS: [(&str, &str, &str); 17] = [
    ("thickness", "h", "mean thickness of the leaf, by the caliper"),
    ("sigma_s_reduced", "σs′", "scattering less what goes straight on, (1 − g) σs"),
    ("g", "g", "mean cosine of a scattering angle"),
    ("a", "A", "what the leaf's inner surface throws back, (1 + ρ)/(1 − ρ)"),
    ("thickness_scale", "s", "factor on the leaf fit's thickness map"),
    ("alpha", "α", "taper: radius at the tip over radius at the root"),
    ("load_over_stiffness", "F/(E′r₁⁴)", "load over the stiffness of the root"),
    ("root_radius", "r₁", "radius at the root"),
    ("tip", "u(1)", "deflection of the tip"),
    ("sun_zenith_deg", "θs", "angle of the sun from straight up"),
    ("sun_azimuth_deg", "φs", "azimuth of the sun, from +x to +y"),
    ("turbidity", "T", "turbidity: 1 is pure air, 6 is hazy"),
    ("scale", "k", "reading of one kcd/m²"),
    ("sigma_a", "σa", "absorption"),
    ("sigma_s", "σs", "scattering"),
    ("sigma_a_h", "σa h", "absorption through the whole leaf, whatever its thickness"),
    ("sigma_s_h", "σs h", "scattering through the whole leaf, whatever its thickness"),
];

/// Symbol and meaning of a parameter.
pub fn parameter(name: &str) -> (String, &'static str) {
    match PARAMETERS.iter().find(|p| p.0 == name) {
        Some((_, symbol, meaning)) => ((*symbol).into(), meaning),
        None => (symbol(name), ""),
    }
}

/// Heading of a quantity, which may be an unknown one.
pub fn title(name: &str) -> String {
    known(name).map_or_else(|| name.to_string(), |q| q.title.to_string())
}

/// Rank in the report: the catalogue's order, then unknown quantities. Green comes before red and blue, because it
/// tells most about leaves.
pub fn rank(channel: &str) -> (usize, String, usize) {
    let (quantity, letter) = split(channel);
    let place = QUANTITIES.iter().position(|q| q.name == quantity).unwrap_or(QUANTITIES.len());
    let letter_rank = ["G", "", "X", "R", "Y", "B"].iter().position(|l| *l == letter).unwrap_or(9);
    (place, quantity.to_string(), letter_rank)
}

/// `R`, `G`, `B` in words.
pub(crate) fn channel_word(letter: &str) -> &str {
    match letter {
        "R" => "red",
        "G" => "green",
        "B" => "blue",
        "X" => "x",
        "Y" => "y",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_take_their_names_apart() {
        assert_eq!(symbol("sigma_a"), "σa");
        assert_eq!((symbol("odd"), symbol("sigma_a_map")), ("odd".into(), "σa maps".into()));
        let mut names = ["odd.Y", "sigma_a.R", "rho_d.B", "sigma_a.G"];
        names.sort_by_key(|n| rank(n));
        assert_eq!(names, ["rho_d.B", "sigma_a.G", "sigma_a.R", "odd.Y"]);
    }
}
