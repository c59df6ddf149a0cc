// The bent beam of a branch, as `src/models/plants/mechanics` has it on the CPU. `pose.wgsl` follows this file.

// What bends a branch.
struct Limb {
    t: vec3f,
    alpha: f32,
    ln_alpha: f32,
    a: vec4f,
    length: f32,
    ell: f32,
}

// artanh(z)/z, and the coordinate along the taper of a share (`plant::taper::coordinate`).
fn reduced(z: f32) -> f32 {
    let s = z * z;
    var sum = 1.0 / 15.0;
    sum = sum * s + 1.0 / 13.0;
    sum = sum * s + 1.0 / 11.0;
    sum = sum * s + 1.0 / 9.0;
    sum = sum * s + 1.0 / 7.0;
    sum = sum * s + 0.2;
    sum = sum * s + 1.0 / 3.0;
    return sum * s + 1.0;
}

fn coordinate(alpha: f32, ln_alpha: f32, x: f32) -> f32 {
    if (alpha < 0.5) {
        return log((1.0 - x) + alpha * x) / ln_alpha;
    }
    let beta = alpha - 1.0;
    let at = 2.0 + beta * x;
    let end = 2.0 + beta;
    return x * end / at * reduced(beta * x / at) / reduced(beta / end);
}

// `plant::taper::position`, from e^z for z = y ln α.
fn position(alpha: f32, ell: f32, y: f32, z: f32, grown: f32) -> f32 {
    if (abs(z) >= 0.5) {
        return (grown - 1.0) / (alpha - 1.0);
    }
    var sum = 1.0 + z / 8.0;
    sum = 1.0 + z * sum / 7.0;
    sum = 1.0 + z * sum / 6.0;
    sum = 1.0 + z * sum / 5.0;
    sum = 1.0 + z * sum / 4.0;
    sum = 1.0 + z * sum / 3.0;
    sum = 1.0 + z * sum / 2.0;
    return y * ell * sum;
}

// P and P′ of the deflection at y.
fn polynomial(a: vec4f, y: f32) -> vec2f {
    return vec2f((((a.w * y + a.z) * y + a.y) * y + a.x) * y * y,
        (((5.0 * a.w * y + 4.0 * a.z) * y + 3.0 * a.y) * y + 2.0 * a.x) * y);
}

// About where the share x of a branch stands along its bent beam (`plant::length::bend`).
fn about(limb: Limb, x: f32, amplitude: f32) -> f32 {
    let straight = polynomial(limb.a, coordinate(limb.alpha, limb.ln_alpha, x));
    let du = amplitude * straight.y / (((1.0 - x) + limb.alpha * x) * limb.ell);
    let root = sqrt(1.0 + du * du);
    return x - amplitude * straight.x * du / ((1.0 + root) * root);
}

// The same between two marks, where the beam goes along by the cosine of its turn.
fn between(a: Mark, b: Mark, x: f32) -> f32 {
    let h = b.place.w - a.place.w;
    let u = (x - a.place.w) / max(h, 1e-9);
    let v = 1.0 - u;
    let from_a = (1.0 + 2.0 * u) * a.beam.x + u * h * a.beam.z;
    let from_b = (1.0 + 2.0 * v) * b.beam.x - v * h * b.beam.z;
    return v * v * from_a + u * u * from_b;
}

// How much faster the bent beam grows with y than the straight one, at three places at once: a loop over them would be
// slower than their formulas.
fn faster(limb: Limb, amplitude: f32, y: vec3f) -> vec3f {
    let a = limb.a;
    let on = exp(y * limb.ln_alpha) * limb.ell;
    let up = amplitude * ((((5.0 * a.w * y + 4.0 * a.z) * y + 3.0 * a.y) * y + 2.0 * a.x) * y);
    return up * up / (sqrt(on * on + up * up) + on);
}

// Where the share x of a branch stands on its bent beam: along, across, and the cosine and sine of its turn.
// `along` is about the first of them.
fn bend(limb: Limb, x: f32, amplitude: f32, along: f32) -> vec4f {
    // Gauss' six nodes lie symmetrically.
    let nodes = vec3f(0.033765243, 0.16939531, 0.38069041);
    let weights = vec3f(0.085662246, 0.18038079, 0.23395697);
    let alpha = limb.alpha;
    let ln_alpha = limb.ln_alpha;
    let ell = limb.ell;
    var y = coordinate(alpha, ln_alpha, clamp(along, 0.0, 1.0));
    for (var step = 0u; step < STEPS; step++) {
        let all = faster(limb, amplitude, y * nodes) + faster(limb, amplitude, y * (1.0 - nodes));
        let grown = exp(y * ln_alpha);
        let speed = length(vec2f(grown * ell, amplitude * polynomial(limb.a, y).y));
        let change = (position(alpha, ell, y, y * ln_alpha, grown) + y * dot(weights, all) - x) / speed;
        y = clamp(y - change, 0.0, 1.0);
        // Each step squares the error.
        if (abs(change) <= 3e-4) {
            break;
        }
    }
    let grown = exp(y * ln_alpha);
    let p = polynomial(limb.a, y);
    let velocity = vec2f(grown * ell, amplitude * p.y);
    return vec4f(position(alpha, ell, y, y * ln_alpha, grown), amplitude * p.x, velocity / length(velocity));
}

// The same where an amplitude of 0 does not bend the branch.
fn bent(limb: Limb, x: f32, amplitude: f32, along: f32) -> vec4f {
    if (amplitude == 0.0) {
        return vec4f(x, 0.0, 1.0, 0.0);
    }
    return bend(limb, x, amplitude, along);
}
