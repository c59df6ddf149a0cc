//#if BEND
// Bends what a branch carries. The branch's own mesh bends vertex by vertex, and what hangs on it moves rigidly (H9 =
// Habel 2009, ch. 4, with the arc length solved for and the Jacobian of the whole map). `bend.rs` does the same on the
// CPU. Everything that depends on time may be stored for more than one time, one after the other. Time 0 is the time
// that is drawn.

struct Branch {
    // Root, and in w the length.
    root: vec4f,
    // Frame at rest: t from root to tip, r and s. The w of t is the taper α, that of r is ln α, and that of s is ℓ = ln
    // α/(α − 1).
    t: vec4f,
    r: vec4f,
    s: vec4f,
    // Coefficients of the deflection a₂y² + … + a₅y⁵ in y = ln(1 + (α − 1)x)/ln α.
    a: vec4f,
    // xy: steady amplitude towards r and s. zw: place of the branch in the motion texture.
    still: vec4f,
    // x: amplitude for 1 in the motion texture.
    gain: vec4f,
}

@group(2) @binding(0) var<uniform> branches: array<Branch, BRANCHES_HELD>;
//#if MOTION
@group(2) @binding(1) var motion: texture_2d<f32>;

// Both channels of the texture, linear between texel centres and periodic.
fn swayed(at: vec2f) -> vec2f {
    let size = vec2i(textureDimensions(motion));
    let p = at * vec2f(size) - 0.5;
    let low = floor(p);
    let f = p - low;
    let i = (vec2i(low) + size) % size;
    let j = (i + 1) % size;
    let top = mix(textureLoad(motion, i, 0).rg, textureLoad(motion, vec2i(j.x, i.y), 0).rg, f.x);
    let bottom = mix(textureLoad(motion, vec2i(i.x, j.y), 0).rg, textureLoad(motion, j, 0).rg, f.x);
    return mix(top, bottom, f.y);
}
//#endif

//#if SECTIONS
// Rigid motions with three texels each, SECTIONS_WIDE in a row: a point at rest, the place it moves to, and a
// quaternion.
@group(2) @binding(2) var sections: texture_2d<f32>;
// The section that carries each vertex of bark, VERTICES_WIDE in a row.
@group(2) @binding(3) var of_vertices: texture_2d<u32>;

fn carried(time: u32, section: u32, position: vec3f, normal: vec3f, tangent: vec3f) -> Bent {
    let at = vec2u(3u * (section % SECTIONS_WIDE), section / SECTIONS_WIDE + time * SECTIONS_ROWS);
    let before = textureLoad(sections, at, 0).xyz;
    let after = textureLoad(sections, at + vec2u(1u, 0u), 0).xyz;
    let turn = textureLoad(sections, at + vec2u(2u, 0u), 0);
    return Bent(after + quaternion(turn, position - before), quaternion(turn, normal), quaternion(turn, tangent));
}

fn quaternion(q: vec4f, v: vec3f) -> vec3f {
    return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}
//#endif

// atanh(z)/z for |z| ≤ 1/3.
fn reduced(z: f32) -> f32 {
    let q = z * z;
    return 1.0 + q * (1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0 + q * (1.0 / 11.0 + q * (1.0 / 13.0 + q / 15.0))))));
}

// y as a function of x, regular at α = 1.
fn bend_coordinate(b: Branch, x: f32) -> f32 {
    let alpha = b.t.w;
    if (alpha < 0.5) {
        return log((1.0 - x) + alpha * x) / b.r.w;
    }
    let beta = alpha - 1.0;
    let at = 2.0 + beta * x;
    let end = 2.0 + beta;
    return x * end / at * reduced(beta * x / at) / reduced(beta / end);
}

// x as a function of y: (α^y − 1)/(α − 1), regular at α = 1.
fn bend_place(b: Branch, y: f32) -> f32 {
    let z = y * b.r.w;
    if (abs(z) >= 0.5) {
        return (exp(z) - 1.0) / (b.t.w - 1.0);
    }
    var sum = 1.0;
    for (var k = 8; k >= 2; k--) {
        sum = 1.0 + z * sum / f32(k);
    }
    return y * b.s.w * sum;
}

// P, P′ and P″ at y.
fn bend_polynomial(a: vec4f, y: f32) -> vec3f {
    let p = ((a.w * y + a.z) * y + a.y) * y + a.x;
    let dp = ((5.0 * a.w * y + 4.0 * a.z) * y + 3.0 * a.y) * y + 2.0 * a.x;
    let ddp = ((20.0 * a.w * y + 12.0 * a.z) * y + 6.0 * a.y) * y + 2.0 * a.x;
    return vec3f(p * y * y, dp * y, ddp);
}

// Derivatives by y of the bent axis: its places along and across.
fn bend_velocity(b: Branch, amplitude: f32, y: f32) -> vec2f {
    return vec2f(exp(y * b.r.w) * b.s.w, amplitude * bend_polynomial(b.a, y).y);
}

struct Axis {
    along: f32,
    across: f32,
    cosine: f32,
    sine: f32,
    curvature: f32,
}

// The axis at arc length x. Two Newton steps follow H9 Eq. 4.9–4.11, with a four-point Gauss rule for the arc.
fn bend_axis(b: Branch, x: f32, amplitude: f32) -> Axis {
    var nodes = array<vec2f, 4>(
        vec2f(0.06943184420297371, 0.17392742256872692), vec2f(0.33000947820757187, 0.3260725774312731),
        vec2f(0.6699905217924281, 0.3260725774312731), vec2f(0.9305681557970263, 0.17392742256872692));
    let first = bend_coordinate(b, x);
    let at_first = bend_polynomial(b.a, first);
    let u = amplitude * at_first.x;
    let du = amplitude * at_first.y / (((1.0 - x) + b.t.w * x) * b.s.w);
    let slant = sqrt(1.0 + du * du);
    var y = bend_coordinate(b, max(x - u * du / ((1.0 + slant) * slant), 0.0));
    for (var step = 0; step < 2; step++) {
        // The quadrature gives the difference between the arc and the straight way, which is known in closed form. So
        // at rest nothing moves.
        var extra = 0.0;
        for (var k = 0; k < 4; k++) {
            let v = bend_velocity(b, amplitude, y * nodes[k].x);
            extra += nodes[k].y * (v.y * v.y / (length(v) + v.x));
        }
        let arc = bend_place(b, y) + y * extra;
        y = clamp(y - (arc - x) / length(bend_velocity(b, amplitude, y)), 0.0, 1.0);
    }
    let p = bend_polynomial(b.a, y);
    let v = bend_velocity(b, amplitude, y);
    let speed = length(v);
    return Axis(
        bend_place(b, y), amplitude * p.x, v.x / speed, v.y / speed,
        amplitude * v.x * (p.z - p.y * b.r.w) / (speed * speed * speed));
}

struct Bent {
    position: vec3f,
    normal: vec3f,
    tangent: vec3f,
}

fn bend_unit(v: vec3f) -> vec3f {
    return v / max(length(v), 1e-30);
}

// Vertex `number` of its mesh, in world space. `ride.x` is the branch, or −1 for none. `ride.y` is the place (0 to 1)
// where the mesh hangs rigidly; below 0, the mesh is the branch's own and bends at every vertex. With `ride.x` ≤ −2 it
// is −2 − a section instead. Then `ride.y` is the first entry of the vertices' own sections; below 0, one section
// carries the whole mesh.
fn bent(ride: vec2f, number: u32, position: vec3f, normal: vec3f, tangent: vec3f) -> Bent {
    return bent_at(0u, ride, number, position, normal, tangent);
}

// The same at one of the times that are stored.
fn bent_at(time: u32, ride: vec2f, number: u32, position: vec3f, normal: vec3f, tangent: vec3f) -> Bent {
    //#if SECTIONS
    if (ride.x <= -2.0) {
        var section = u32(-2.0 - ride.x);
        if (ride.y >= 0.0) {
            let vertex = u32(ride.y) + number;
            section += textureLoad(of_vertices, vec2u(vertex % VERTICES_WIDE, vertex / VERTICES_WIDE), 0).r;
        }
        return carried(time, section, position, normal, tangent);
    }
    //#endif
    if (ride.x < 0.0) {
        return Bent(position, normal, tangent);
    }
    let b = branches[time * BRANCHES + u32(ride.x)];
    var amplitude = b.still.xy;
    //#if MOTION
    amplitude += b.gain.x * swayed(b.still.zw);
    //#endif
    let size = length(amplitude);
    var share = vec2f(1.0, 0.0);
    if (size > 0.0) {
        share = amplitude / size;
    }
    let span = b.root.w;
    let local = position - b.root.xyz;
    let along = dot(local, b.t.xyz) / span;
    let rigid = ride.y >= 0.0;
    let x = select(clamp(along, 0.0, 1.0), ride.y, rigid);
    let axis = bend_axis(b, x, size);
    // Unit vectors in the plane of bending and across it, at rest.
    let e = share.x * b.r.xyz + share.y * b.s.xyz;
    let f = share.x * b.s.xyz - share.y * b.r.xyz;
    let turned_t = axis.cosine * b.t.xyz + axis.sine * e;
    let turned_e = axis.cosine * e - axis.sine * b.t.xyz;
    let over = dot(local, e);
    var stretch = 1.0;
    if (!rigid && along >= 0.0 && along <= 1.0) {
        stretch = max(1.0 - axis.curvature * over / span, 0.05);
    }
    var out: Bent;
    out.position = b.root.xyz + span * (axis.along * b.t.xyz + axis.across * e)
        + (along - x) * span * turned_t + over * turned_e + dot(local, f) * f;
    out.normal = bend_unit(dot(normal, b.t.xyz) / stretch * turned_t + dot(normal, e) * turned_e + dot(normal, f) * f);
    out.tangent = bend_unit(dot(tangent, b.t.xyz) * stretch * turned_t + dot(tangent, e) * turned_e + dot(tangent, f) * f);
    return out;
}
//#endif
