//! A vertex on a bent branch: position, tangent and normal. The `f64` form is the reference of the vertex shader, the
//! `f32` form mirrors the shader.
//!
//! The two deflections of H9 Eq. 4.12 have the same shape, so together they are one bend in one plane, of amplitude |A|
//! towards (A_r r + A_s s)/|A|. The axis follows [`super::length::bend`]. Cross-sections stay plane and turn with the
//! axis, so the map is
//!
//! ```text
//! p(x, e, b) = C(x) + e N(x) + b B,      ∂p/∂x = (1 − κ e) T,   ∂p/∂e = N,   ∂p/∂b = B
//! ```
//!
//! Here C is the bent axis, T, N and B are its tangent, its normal in the plane of bending and its binormal, and κ is
//! its curvature. The Jacobian is exact except for the stretch that remains after the two Newton steps (below 1e-3). H9
//! Eq. 4.13 adds two length corrections and does not turn cross-sections. Its Eq. 4.14 takes the Jacobian of the
//! uncorrected deflection (and row 3 prints d_s/s_r for d_s/s_s). Beyond the tip a vertex moves rigidly with the tip.

use super::length::{AxisPoint, bend};
use super::taper::TaperShape;
use mesophyll_base::number::FloatingPoint;

/// A branch at rest: root, orthonormal frame (t from root to tip), length (m, or whatever the vertices are in).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BranchFrame<T> {
    /// Where the branch begins.
    pub root: [T; 3],
    /// Unit vector from root to tip.
    pub t: [T; 3],
    /// First unit vector across the branch.
    pub r: [T; 3],
    /// Second unit vector across the branch.
    pub s: [T; 3],
    /// Distance from root to tip.
    pub length: T,
    /// How it bends.
    pub shape: TaperShape<T>,
}

/// A vertex after bending. Tangent and normal have length 1 (zero vectors stay zero).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeformedVertex<T> {
    /// The vertex after bending.
    pub position: [T; 3],
    /// Tangent there, of length 1 or 0.
    pub tangent: [T; 3],
    /// Normal there, of length 1 or 0.
    pub normal: [T; 3],
}

/// The branch's frame where something is attached: a leaf or a sub-branch moves rigidly with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointFrame<T> {
    /// The axis there.
    pub position: [T; 3],
    /// Unit vector along the axis there.
    pub t: [T; 3],
    /// First unit vector across it.
    pub r: [T; 3],
    /// Second unit vector across it.
    pub s: [T; 3],
}

/// Smallest stretch on the inside of a bend: with less the surface would fold through itself.
const LEAST_STRETCH: f64 = 0.05;

fn dot<T: FloatingPoint>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// x a + y b + z c.
fn mix<T: FloatingPoint>(x: T, a: [T; 3], y: T, b: [T; 3], z: T, c: [T; 3]) -> [T; 3] {
    std::array::from_fn(|k| x * a[k] + y * b[k] + z * c[k])
}

fn unit<T: FloatingPoint>(v: [T; 3]) -> [T; 3] {
    let length = dot(v, v).sqrt();
    if length > T::zero() { v.map(|c| c / length) } else { v }
}

/// The plane of bending at one place along a branch.
struct Plane<T> {
    bent: AxisPoint<T>,
    /// Direction of the load, and the direction that bending does not change, in the frame of the branch at rest.
    e: [T; 3],
    b: [T; 3],
    /// After bending: tangent of the axis, and direction in the plane.
    turned_t: [T; 3],
    turned_e: [T; 3],
    /// Share of r and s in e.
    share: [T; 2],
}

impl<T: FloatingPoint> BranchFrame<T> {
    /// `amplitude`: A_r and A_s, in units of the branch's length for each unit of normalised deflection: F/(E′r₁⁴) over
    /// L, along r and s.
    fn plane(&self, x: T, amplitude: [T; 2]) -> Plane<T> {
        let size = (amplitude[0] * amplitude[0] + amplitude[1] * amplitude[1]).sqrt();
        let share = if size > T::zero() { [amplitude[0] / size, amplitude[1] / size] } else { [T::one(), T::zero()] };
        let bent = bend(&self.shape, x, size);
        let zero = T::zero();
        let e = mix(share[0], self.r, share[1], self.s, zero, self.t);
        let b = mix(-share[1], self.r, share[0], self.s, zero, self.t);
        Plane {
            turned_t: mix(bent.cos, self.t, bent.sin, e, zero, b),
            turned_e: mix(-bent.sin, self.t, bent.cos, e, zero, b),
            bent,
            e,
            b,
            share,
        }
    }

    /// The axis after bending.
    fn axis(&self, plane: &Plane<T>) -> [T; 3] {
        let moved =
            mix(self.length * plane.bent.along, self.t, self.length * plane.bent.across, plane.e, T::one(), self.root);
        std::array::from_fn(|k| moved[k])
    }

    /// Moves a vertex; `amplitude` as (A_r, A_s) = F/(E′r₁⁴)/L towards r and s (see [`BranchFrame::amplitude_of_tip`]).
    pub fn deform(&self, amplitude: [T; 2], position: [T; 3], tangent: [T; 3], normal: [T; 3]) -> DeformedVertex<T> {
        let local: [T; 3] = std::array::from_fn(|k| position[k] - self.root[k]);
        let along = dot(local, self.t) / self.length;
        let x = along.at_least(T::zero()).at_most(T::one());
        let plane = self.plane(x, amplitude);
        let (e, b) = (dot(local, plane.e), dot(local, plane.b));
        let axis = self.axis(&plane);
        let off = mix((along - x) * self.length, plane.turned_t, e, plane.turned_e, b, plane.b);
        // A vertex beyond an end does not stretch: it moves rigidly with the end.
        let inside = along >= T::zero() && along <= T::one();
        let stretch = if inside {
            (T::one() - plane.bent.curvature * e / self.length).at_least(T::of(LEAST_STRETCH))
        } else {
            T::one()
        };
        let turn = |v: [T; 3], factor: T| {
            unit(mix(
                factor * dot(v, self.t),
                plane.turned_t,
                dot(v, plane.e),
                plane.turned_e,
                dot(v, plane.b),
                plane.b,
            ))
        };
        DeformedVertex {
            position: std::array::from_fn(|k| axis[k] + off[k]),
            tangent: turn(tangent, stretch),
            normal: turn(normal, T::one() / stretch),
        }
    }

    /// The frame at `x` (0 root, 1 tip) after bending.
    pub fn joint(&self, amplitude: [T; 2], x: T) -> JointFrame<T> {
        let plane = self.plane(x.at_least(T::zero()).at_most(T::one()), amplitude);
        let [c, d] = plane.share;
        let zero = T::zero();
        JointFrame {
            position: self.axis(&plane),
            t: plane.turned_t,
            r: mix(c, plane.turned_e, -d, plane.b, zero, plane.b),
            s: mix(d, plane.turned_e, c, plane.b, zero, plane.b),
        }
    }

    /// Carries a point that is attached to the branch at `x`: it moves rigidly with the bend at `x`.
    pub fn carry(&self, joint: &JointFrame<T>, x: T, point: [T; 3]) -> [T; 3] {
        let rest: [T; 3] = std::array::from_fn(|k| point[k] - self.root[k] - x * self.length * self.t[k]);
        let turned = self.turn(joint, rest);
        std::array::from_fn(|k| joint.position[k] + turned[k])
    }

    /// Turns a direction that is attached to the branch (a leaf's normal, a sub-branch's axes) with the bend.
    pub fn turn(&self, joint: &JointFrame<T>, direction: [T; 3]) -> [T; 3] {
        mix(dot(direction, self.t), joint.t, dot(direction, self.r), joint.r, dot(direction, self.s), joint.s)
    }

    /// Carries a sub-branch that is attached at `x`. The sub-branch itself is still at rest; bend it afterwards.
    pub fn child(&self, joint: &JointFrame<T>, x: T, child: &BranchFrame<T>) -> BranchFrame<T> {
        BranchFrame {
            root: self.carry(joint, x, child.root),
            t: self.turn(joint, child.t),
            r: self.turn(joint, child.r),
            s: self.turn(joint, child.s),
            ..*child
        }
    }

    /// The amplitude whose (uncorrected) tip deflection is `tip`, in units of the branch's length.
    pub fn amplitude_of_tip(&self, tip: [T; 2]) -> [T; 2] {
        let whole = self.shape.tip();
        tip.map(|t| t / whole)
    }
}

impl BranchFrame<f64> {
    /// The same branch as a shader holds it.
    pub fn single(&self) -> BranchFrame<f32> {
        let f = |v: [f64; 3]| v.map(|c| c as f32);
        BranchFrame {
            root: f(self.root),
            t: f(self.t),
            r: f(self.r),
            s: f(self.s),
            length: self.length as f32,
            shape: self.shape.single(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficients of a slender taper. The test is about the map, not about their accuracy.
    fn branch() -> BranchFrame<f64> {
        let (c, s) = (0.6, 0.8);
        BranchFrame {
            root: [0.3, -1.0, 2.0],
            t: [c, s, 0.0],
            r: [-s, c, 0.0],
            s: [0.0, 0.0, 1.0],
            length: 2.5,
            shape: TaperShape::new(0.2, [0.82, -0.95, 0.66, -0.02]),
        }
    }

    fn at(b: &BranchFrame<f64>, x: f64, e: [f64; 2]) -> [f64; 3] {
        std::array::from_fn(|k| b.root[k] + x * b.length * b.t[k] + e[0] * b.r[k] + e[1] * b.s[k])
    }

    fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
        let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        dot(cross, cross).sqrt().atan2(dot(a, b)).to_degrees()
    }

    /// Compares tangents with differences of moved points, and normals with the cross product of two tangents.
    #[test]
    fn tangents_and_normals_are_those_of_the_map() {
        let b = branch();
        let amplitude = b.amplitude_of_tip([0.45, -0.5]);
        let offset = [0.02, 0.015];
        let mut worst = [0.0f64; 2];
        for x in [0.05, 0.3, 0.6, 0.9, 0.98] {
            let moved = |x: f64, o: [f64; 2]| b.deform(amplitude, at(&b, x, o), [1.0; 3], [1.0; 3]).position;
            let h = 1e-6;
            let d = |p: [f64; 3], q: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| (p[k] - q[k]) / (2.0 * h)) };
            let dx = d(moved(x + h / b.length, offset), moved(x - h / b.length, offset));
            let dr = d(moved(x, [offset[0] + h, offset[1]]), moved(x, [offset[0] - h, offset[1]]));
            let ds = d(moved(x, [offset[0], offset[1] + h]), moved(x, [offset[0], offset[1] - h]));
            // A tangent with a part along each axis of the frame, and the normal of the plane that two tangents span.
            let t: [f64; 3] = std::array::from_fn(|k| 0.5 * b.t[k] + 0.7 * b.r[k] - 0.3 * b.s[k]);
            let numeric: [f64; 3] = std::array::from_fn(|k| 0.5 * dx[k] + 0.7 * dr[k] - 0.3 * ds[k]);
            let other: [f64; 3] = std::array::from_fn(|k| dx[k] + 0.4 * dr[k]);
            let normal = [
                numeric[1] * other[2] - numeric[2] * other[1],
                numeric[2] * other[0] - numeric[0] * other[2],
                numeric[0] * other[1] - numeric[1] * other[0],
            ];
            let rest = {
                let o: [f64; 3] = std::array::from_fn(|k| b.t[k] + 0.4 * b.r[k]);
                [t[1] * o[2] - t[2] * o[1], t[2] * o[0] - t[0] * o[2], t[0] * o[1] - t[1] * o[0]]
            };
            let got = b.deform(amplitude, at(&b, x, offset), t, rest);
            worst[0] = worst[0].max(angle(got.tangent, numeric));
            worst[1] = worst[1].max(angle(got.normal, normal));
        }
        println!("worst angle of tangent {:.4}°, of normal {:.4}°", worst[0], worst[1]);
        assert!(worst[0] < 0.05 && worst[1] < 0.05, "{worst:?}");
    }

    #[test]
    fn no_load_changes_nothing_and_two_loads_are_one_plane() {
        let b = branch();
        let p = at(&b, 0.7, [0.03, -0.02]);
        let t = unit([0.3, 0.5, -0.2]);
        let still = b.deform([0.0; 2], p, t, t);
        for k in 0..3 {
            assert!((still.position[k] - p[k]).abs() < 1e-12 && (still.tangent[k] - t[k]).abs() < 1e-12);
        }
        // The same bend in a frame that is turned so that the bend is along r alone.
        let (c, s) = (0.8, 0.6);
        let turned = BranchFrame { r: mix(c, b.r, s, b.s, 0.0, b.t), s: mix(-s, b.r, c, b.s, 0.0, b.t), ..b };
        let one = b.deform([0.8 * 1.3, 0.6 * 1.3], p, t, t);
        let other = turned.deform([1.3, 0.0], p, t, t);
        for k in 0..3 {
            assert!(
                (one.position[k] - other.position[k]).abs() < 1e-12 && (one.normal[k] - other.normal[k]).abs() < 1e-12
            );
        }
    }

    #[test]
    fn joints_are_orthonormal_and_carry_what_hangs_on_them() {
        let b = branch();
        let amplitude = b.amplitude_of_tip([-0.2, 0.6]);
        for x in [0.0, 0.5, 1.0] {
            let j = b.joint(amplitude, x);
            for (u, v, want) in
                [(j.t, j.t, 1.0), (j.r, j.r, 1.0), (j.s, j.s, 1.0), (j.t, j.r, 0.0), (j.r, j.s, 0.0), (j.s, j.t, 0.0)]
            {
                assert!((dot(u, v) - want).abs() < 1e-12);
            }
            let offset = [0.1, -0.05];
            let moved = b.deform(amplitude, at(&b, x, offset), b.t, b.r).position;
            let carried = b.carry(&j, x, at(&b, x, offset));
            for k in 0..3 {
                assert!((moved[k] - carried[k]).abs() < 1e-12, "{moved:?} {carried:?}");
            }
        }
        // A sub-branch keeps its own frame orthonormal, and its distances to the joint.
        let j = b.joint(amplitude, 0.5);
        let child =
            b.child(&j, 0.5, &BranchFrame { root: at(&b, 0.5, [0.2, 0.0]), t: b.r, r: b.s, s: b.t, length: 0.5, ..b });
        assert!((dot(child.t, child.r)).abs() < 1e-12 && (dot(child.t, child.t) - 1.0).abs() < 1e-12);
        let arm: [f64; 3] = std::array::from_fn(|k| child.root[k] - j.position[k]);
        assert!((dot(arm, arm) - 0.04).abs() < 1e-12 && (dot(arm, child.t) - 0.2).abs() < 1e-12);
        // Beyond the tip: rigid with it.
        let tip = b.joint(amplitude, 1.0);
        let beyond = b.deform(amplitude, at(&b, 1.1, [0.0; 2]), b.t, b.r);
        for k in 0..3 {
            assert!((beyond.position[k] - tip.position[k] - 0.25 * tip.t[k]).abs() < 1e-12);
            assert!((beyond.tangent[k] - tip.t[k]).abs() < 1e-12);
        }
    }

    #[test]
    fn the_single_precision_mirror_stays_close() {
        let b = branch();
        let single = b.single();
        let mut worst = [0.0f64; 2];
        for k in 0..200 {
            let x = f64::from(k) / 199.0;
            let amplitude = b.amplitude_of_tip([0.5 * (0.1 * f64::from(k)).sin(), 0.4]);
            let p = at(&b, x, [0.02, -0.01]);
            let f = |v: [f64; 3]| v.map(|c| c as f32);
            let wide = b.deform(amplitude, p, b.t, b.r);
            let narrow = single.deform(amplitude.map(|a| a as f32), f(p), f(b.t), f(b.r));
            for k in 0..3 {
                worst[0] = worst[0].max((wide.position[k] - f64::from(narrow.position[k])).abs() / b.length);
            }
            worst[1] = worst[1].max(angle(wide.normal, narrow.normal.map(f64::from)));
        }
        println!("f32 against f64: {:.1e} L, {:.1e}°", worst[0], worst[1]);
        assert!(worst[0] < 3e-6 && worst[1] < 1e-3, "{worst:?}");
    }
}
