//! Leaves that are the same everywhere: what they reflect and let through, or the slab that they are.

use super::spectrum::{StatedSpectrum, unstated};
use mesophyll_optics::slab;
use serde::Deserialize;

/// A leaf whose reflection is stated: on either side f_r = ρd/π + ρs·f_s, where ρs·f_s is the gloss, and in both
/// directions f_t = ρt/π.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "StatedUniform")]
pub struct UniformLeaf {
    /// Diffuse reflectance of the front and of the back, linear sRGB; from the spectrum where it is not stated.
    pub rho_d: [[f64; 3]; 2],
    /// Transmittance, the same in both directions; from the spectrum where it is not stated.
    pub rho_t: [f64; 3],
    /// Reflectance ρs of the gloss on both sides. ρd is not reduced by it. The leaf is matte when this is absent.
    pub rho_s: Option<[f64; 3]>,
    /// Root mean square slope m of the gloss.
    pub m: f64,
    /// The slab that ρd and ρt are those of, where the scene states that instead.
    pub slab: Option<UniformSlab>,
    /// A table of reflectance and transmittance over wavelength, for light of any band.
    pub spectrum: Option<StatedSpectrum>,
}

/// The tissue of a leaf as a slab ([`slab`]), lit along its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UniformSlab {
    /// Absorption coefficient of each channel (1/mm).
    pub sigma_a: [f64; 3],
    /// Scattering coefficient of each channel (1/mm).
    pub sigma_s: [f64; 3],
    /// Thickness (mm).
    pub thickness_mm: f64,
}

/// What the scene file states.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StatedUniform {
    rho_d: Option<[[f64; 3]; 2]>,
    rho_t: Option<[f64; 3]>,
    sigma_a: Option<[f64; 3]>,
    sigma_s: Option<[f64; 3]>,
    thickness_mm: Option<f64>,
    rho_s: Option<[f64; 3]>,
    #[serde(default = "slope")]
    m: f64,
    spectrum: Option<StatedSpectrum>,
}

fn slope() -> f64 {
    0.2
}

impl TryFrom<StatedUniform> for UniformLeaf {
    type Error = String;

    fn try_from(stated: StatedUniform) -> Result<UniformLeaf, String> {
        const EXPECTED: &str = "expected rho_d and rho_t, a spectrum, or sigma_a, sigma_s and thickness_mm";
        let StatedUniform { rho_d, rho_t, sigma_a, sigma_s, thickness_mm, rho_s, m, spectrum } = stated;
        let of_slab = [sigma_a.is_some(), sigma_s.is_some(), thickness_mm.is_some()].contains(&true);
        if of_slab && (rho_d.is_some() || rho_t.is_some() || spectrum.is_some()) {
            return Err(format!("found reflectances beside the numbers of a slab, which say the same; {EXPECTED}"));
        }
        let missing = |name: &str| format!("missing field `{name}`; {EXPECTED}");
        if !of_slab {
            let (rho_d, rho_t) = (rho_d.unwrap_or([unstated(); 2]), rho_t.unwrap_or_else(unstated));
            return Ok(UniformLeaf { rho_d, rho_t, rho_s, m, slab: None, spectrum });
        }
        let slab = UniformSlab {
            sigma_a: sigma_a.ok_or_else(|| missing("sigma_a"))?,
            sigma_s: sigma_s.ok_or_else(|| missing("sigma_s"))?,
            thickness_mm: thickness_mm.ok_or_else(|| missing("thickness_mm"))?,
        };
        let [rho_d, rho_t] = slab.response();
        Ok(UniformLeaf { rho_d: [rho_d; 2], rho_t, rho_s, m, slab: Some(slab), spectrum: None })
    }
}

impl UniformLeaf {
    /// ρs, unless it is zero.
    pub fn gloss(&self) -> Option<[f64; 3]> {
        self.rho_s.filter(|rho_s| rho_s.iter().any(|v| *v > 0.0))
    }
}

impl UniformSlab {
    /// ρd and ρt of each channel.
    pub fn response(&self) -> [[f64; 3]; 2] {
        let all = [0, 1, 2].map(|c| slab::response(self.sigma_a[c], self.sigma_s[c], self.thickness_mm));
        [all.map(|r| r.rho_d), all.map(|r| r.rho_t)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slab_is_stated_as_a_whole_and_gives_both_sides() {
        let read = |text: &str| toml::from_str::<UniformLeaf>(text).map_err(|e| e.message().to_string());
        let slab = "sigma_a = [1, 2, 3]\nsigma_s = [8, 9, 10]\nthickness_mm = 0.2\n";
        let leaf = read(slab).unwrap();
        let exact = slab::medium::response(2.0, 9.0, 0.2);
        assert!((leaf.rho_d[1][1] - exact.rho_d).abs() < 1e-6 && (leaf.rho_t[1] - exact.rho_t).abs() < 1e-6);
        assert!(leaf.rho_d[0] == leaf.rho_d[1] && leaf.m == 0.2);
        let both = read(&format!("{slab}rho_t = [0, 0, 0]\n")).unwrap_err();
        assert!(both.starts_with("found reflectances beside the numbers of a slab"), "{both}");
        let part = read("sigma_a = [1, 2, 3]\nthickness_mm = 0.2\n").unwrap_err();
        assert!(part.starts_with("missing field `sigma_s`"), "{part}");
        assert_eq!(read("rho_d = [[0, 0, 0], [0, 0, 0]]\n").unwrap().lacks(), Some("rho_t"));
    }
}
