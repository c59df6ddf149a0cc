//! Random numbers that depend only on a seed and a place, never on the order in which threads ask: hashed counters,
//! Gaussian deviates, and smooth noise over the plane. The code is kept here and not taken from a crate, so that the
//! bytes of a capture do not change with crate versions.

/// A stream of 64-bit numbers (SplitMix64; Steele, Lea & Flood 2014).
#[derive(Debug, Clone)]
pub struct RandomStream(u64);

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl RandomStream {
    /// The stream that belongs to `seed` and a list of names or places.
    pub fn new(seed: u64, place: &[u64]) -> RandomStream {
        let mut state = mix(seed ^ 0x9e37_79b9_7f4a_7c15);
        for p in place {
            state = mix(state.wrapping_add(0x9e37_79b9_7f4a_7c15) ^ mix(p.wrapping_add(0x632b_e59b_d9b4_e019)));
        }
        RandomStream(state)
    }

    /// The next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform in [−1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.uniform() - 1.0
    }

    /// Two independent standard normal deviates (Box & Muller 1958).
    pub fn normal_pair(&mut self) -> [f64; 2] {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        let (s, c) = (std::f64::consts::TAU * self.uniform()).sin_cos();
        [radius * c, radius * s]
    }
}

/// Smooth noise of mean ~0 and standard deviation ~1 with features of size `length`, from gradients at lattice points.
pub fn noise(seed: u64, p: [f64; 2], length: f64) -> f64 {
    let (mut sum, mut amplitude, mut scale) = (0.0, 1.0, 1.0 / length);
    for octave in 0..3 {
        sum += amplitude * gradient_noise(seed.wrapping_add(octave), [p[0] * scale, p[1] * scale]);
        amplitude *= 0.5;
        scale *= 2.0;
    }
    sum * 3.0
}

fn gradient_noise(seed: u64, p: [f64; 2]) -> f64 {
    let (i, j) = (p[0].floor(), p[1].floor());
    let (x, y) = (p[0] - i, p[1] - j);
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let corner = |di: f64, dj: f64| {
        let angle = std::f64::consts::TAU
            * RandomStream::new(seed, &[(i + di) as i64 as u64, (j + dj) as i64 as u64]).uniform();
        angle.cos() * (x - di) + angle.sin() * (y - dj)
    };
    let (u, v) = (fade(x), fade(y));
    let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
    lerp(lerp(corner(0.0, 0.0), corner(1.0, 0.0), u), lerp(corner(0.0, 1.0), corner(1.0, 1.0), u), v)
}

/// Jittered points lie one in each cell of size `length`. This is the distance to the border between the two nearest
/// points, in units of `length`.
pub fn mesh(seed: u64, p: [f64; 2], length: f64) -> f64 {
    let q = [p[0] / length, p[1] / length];
    let (i, j) = (q[0].floor(), q[1].floor());
    let mut near = [(f64::MAX, [0.0; 2]); 2];
    for a in -2..=2 {
        for b in -2..=2 {
            let (ci, cj) = (i + f64::from(a), j + f64::from(b));
            let mut s = RandomStream::new(seed, &[ci as i64 as u64, cj as i64 as u64]);
            let c = [ci + 0.5 + 0.42 * s.signed(), cj + 0.5 + 0.42 * s.signed()];
            let d = (c[0] - q[0]).hypot(c[1] - q[1]);
            if d < near[0].0 {
                near = [(d, c), near[0]];
            } else if d < near[1].0 {
                near[1] = (d, c);
            }
        }
    }
    let [(d0, c0), (d1, c1)] = near;
    let apart = (c1[0] - c0[0]).hypot(c1[1] - c0[1]);
    (d1 * d1 - d0 * d0) / (2.0 * apart)
}
