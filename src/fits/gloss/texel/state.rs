//! Where the fit of a texel stands: its parameters, and what the projection gives for each channel.

use super::super::projection::{ChannelProjection, NONLINEAR};

/// Where the solver stands.
#[derive(Debug, Clone, Copy)]
pub(in crate::gloss) struct State {
    /// ln m, tilt, tilt_y.
    pub p: [f64; NONLINEAR],
    pub channels: [ChannelProjection; 3],
    pub chi2: f64,
}

impl State {
    /// How much χ² would rise if ρs were zero, with ρd refitted and everything else fixed.
    pub fn gloss_chi2(&self) -> f64 {
        let of = |c: &ChannelProjection| {
            let own = c.ss - if c.dd > 0.0 { c.ds * c.ds / c.dd } else { 0.0 };
            c.rho_s * c.rho_s * own
        };
        self.channels.iter().map(of).sum()
    }

    /// Takes a small step without evaluating the model: ρd and ρs move as the projection says, and χ² falls as
    /// predicted.
    pub(super) fn shift(&mut self, step: &[f64; NONLINEAR], predicted: f64) {
        for (p, s) in self.p.iter_mut().zip(step) {
            *p += s;
        }
        for c in &mut self.channels {
            let mut pull = [0.0; 2];
            for (z, s) in c.zphi.iter().zip(step) {
                pull[0] += z[0] * s;
                pull[1] += z[1] * s;
            }
            c.rho_d = (c.rho_d - c.inverse[0][0] * pull[0] - c.inverse[0][1] * pull[1]).max(0.0);
            c.rho_s = (c.rho_s - c.inverse[1][0] * pull[0] - c.inverse[1][1] * pull[1]).max(0.0);
        }
        self.chi2 = (self.chi2 - predicted).max(0.0);
    }
}
