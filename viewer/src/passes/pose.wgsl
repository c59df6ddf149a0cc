// Poses the branches of plants once a frame, in single precision, as `src/flora/pose` does on the CPU in double
// precision. Five passes follow each other: every branch bends in its own frame; joints sit on their parents; bases are
// carried along the hierarchy; sections follow their branches; boxes of parts are united, where shadow maps need them.
// The vertex stage only looks sections up.
//
// Places on a branch are counted from its root at rest, so that they keep their digits far from the scene's origin.

struct Limb {
    root: vec3f,
    length: f32,
    t: vec3f,
    alpha: f32,
    r: vec3f,
    ln_alpha: f32,
    // The root from the place on the parent's axis where the branch grows, at rest.
    offset: vec3f,
    ell: f32,
    a: vec4f,
    // The share of the parent's axis, the parent (−1 for none), the parent's piece there, and the first own piece.
    at: f32,
    parent: i32,
    parent_piece: u32,
    first_piece: u32,
    pieces: u32,
    // What the branch carries, among `members`.
    first_member: u32,
    members: u32,
    unused: u32,
}

struct Piece {
    place: vec3f,
    begin: f32,
    way: vec3f,
    unused: f32,
}

// The beginning of a piece on the bent branch: its place, and its places along and across the bent beam.
struct Mark {
    place: vec3f,
    along: f32,
    across: f32,
}

// What a branch does at this time.
struct State {
    // The joint on the parent, from the parent's root and before the parent's base moves it.
    to: vec3f,
    turn: vec4f,
    // The base: where the joint is in the scene, and how it has turned.
    base_to: vec3f,
    base_turn: vec4f,
    amplitude: vec2f,
}

struct Seat {
    point: vec3f,
    share: f32,
    offset: vec3f,
    limb: u32,
    axis: vec3f,
    piece: u32,
}

// A box with any axes, whose half sides are x, y and z.
struct Oriented {
    centre: vec3f,
    // 0 for a section that carries nothing.
    carries: f32,
    x: vec3f,
    y: vec3f,
    z: vec3f,
}

// A box with the axes of the scene.
struct Box {
    low: vec3f,
    high: vec3f,
}

@group(0) @binding(0) var<storage, read> limbs: array<Limb>;
@group(0) @binding(1) var<storage, read> pieces: array<Piece>;
@group(0) @binding(2) var<storage, read> seats: array<Seat>;
@group(0) @binding(3) var<storage, read> amplitudes: array<vec2f>;
// The angle by which each section turns about its seat's axis.
@group(0) @binding(4) var<storage, read> turns: array<f32>;
// The boxes around what each section carries at rest.
@group(0) @binding(5) var<storage, read> at_rest: array<Oriented>;
@group(0) @binding(6) var<storage, read> members: array<u32>;
@group(0) @binding(7) var<storage, read_write> marks: array<Mark>;
@group(0) @binding(8) var<storage, read_write> states: array<State>;
@group(0) @binding(9) var<storage, read_write> boxes: array<Box>;
@group(0) @binding(10) var<storage, read_write> parts: array<Box>;
@group(0) @binding(11) var sections: texture_storage_2d<rgba32float, write>;

const REST = vec4f(0.0, 0.0, 0.0, 1.0);
// The corners of an empty box.
const NOWHERE = 1e30;

fn rotate(q: vec4f, v: vec3f) -> vec3f {
    return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}

// The rotation `b`, and then `a`.
fn after(a: vec4f, b: vec4f) -> vec4f {
    return vec4f(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
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

// Where the share x of a branch stands on its bent beam: along, across, and the cosine and sine of its turn
// (`plant::length::bend`).
fn bend(k: u32, x: f32, amplitude: f32) -> vec4f {
    var nodes = array<vec2f, 6>(
        vec2f(0.033765243, 0.085662246), vec2f(0.16939531, 0.18038079), vec2f(0.38069041, 0.23395697),
        vec2f(0.61930959, 0.23395697), vec2f(0.83060469, 0.18038079), vec2f(0.96623476, 0.085662246));
    let alpha = limbs[k].alpha;
    let ln_alpha = limbs[k].ln_alpha;
    let ell = limbs[k].ell;
    let a = limbs[k].a;
    let straight = polynomial(a, coordinate(alpha, ln_alpha, x));
    let du = amplitude * straight.y / (((1.0 - x) + alpha * x) * ell);
    let root = sqrt(1.0 + du * du);
    var y = coordinate(alpha, ln_alpha, max(x - amplitude * straight.x * du / ((1.0 + root) * root), 0.0));
    for (var step = 0u; step < STEPS; step++) {
        var extra = 0.0;
        for (var n = 0u; n < 6u; n++) {
            let v = y * nodes[n].x;
            let along = exp(v * ln_alpha) * ell;
            let up = amplitude * polynomial(a, v).y;
            extra += nodes[n].y * up * up / (sqrt(along * along + up * up) + along);
        }
        let grown = exp(y * ln_alpha);
        let speed = length(vec2f(grown * ell, amplitude * polynomial(a, y).y));
        let change = (position(alpha, ell, y, y * ln_alpha, grown) + y * extra - x) / speed;
        y = clamp(y - change, 0.0, 1.0);
        // Each step squares the error.
        if (abs(change) <= 3e-4) {
            break;
        }
    }
    let grown = exp(y * ln_alpha);
    let p = polynomial(a, y);
    let velocity = vec2f(grown * ell, amplitude * p.y);
    return vec4f(position(alpha, ell, y, y * ln_alpha, grown), amplitude * p.x, velocity / length(velocity));
}

// How far the axis goes from the beginning of a piece to the share x of the bent branch (`Swung::end`).
fn gone(k: u32, piece: u32, x: f32, e: vec3f, earlier: vec2f, later: vec2f) -> vec3f {
    let t = limbs[k].t;
    let b = cross(t, e);
    let way = pieces[piece].way;
    let d = later - earlier;
    let within = dot(way, t) * (d.x * t + d.y * e) + dot(way, e) * (d.x * e - d.y * t);
    return limbs[k].length * (within + dot(way, b) * (x - pieces[piece].begin) * b);
}

fn direction(k: u32, amplitude: vec2f) -> vec3f {
    let t = limbs[k].t;
    let r = limbs[k].r;
    let size = length(amplitude);
    return select(r, (amplitude.x * r + amplitude.y * cross(t, r)) / size, size > 0.0);
}

@compute @workgroup_size(64)
fn bend_limbs(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&limbs)) {
        return;
    }
    let amplitude = amplitudes[k];
    states[k].amplitude = amplitude;
    let size = length(amplitude);
    if (size == 0.0) {
        return;
    }
    let e = direction(k, amplitude);
    let first = limbs[k].first_piece;
    var place = pieces[first].place;
    var before = vec2f(0.0);
    for (var n = 0u; n < limbs[k].pieces; n++) {
        let piece = first + n;
        let x = pieces[piece].begin;
        let bent = bend(k, x, size);
        if (n > 0u) {
            place += gone(k, piece - 1u, x, e, before, bent.xy);
        }
        before = bent.xy;
        marks[piece] = Mark(place, bent.x, bent.y);
    }
}

struct Rigid {
    // From the branch's root.
    to: vec3f,
    turn: vec4f,
}

// The cross-section at the share x of branch k, on its given piece, before the base moves it.
fn own(k: u32, x: f32, number: u32) -> Rigid {
    let piece = limbs[k].first_piece + number;
    let amplitude = states[k].amplitude;
    let size = length(amplitude);
    if (size == 0.0) {
        let rest = pieces[piece];
        return Rigid(rest.place + rest.way * ((x - rest.begin) * limbs[k].length), REST);
    }
    let e = direction(k, amplitude);
    let bent = bend(k, x, size);
    let mark = marks[piece];
    let to = mark.place + gone(k, piece, x, e, vec2f(mark.along, mark.across), bent.xy);
    // Half the turn in the plane of t and e.
    let cosine = sqrt(0.5 + 0.5 * bent.z);
    return Rigid(to, vec4f(cross(limbs[k].t, e) * (0.5 * bent.w / cosine), cosine));
}

// The joint of every branch on its parent, before the parent's base moves it.
@compute @workgroup_size(64)
fn join_limbs(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&limbs)) {
        return;
    }
    let parent = limbs[k].parent;
    if (parent >= 0) {
        let joint = own(u32(parent), limbs[k].at, limbs[k].parent_piece);
        states[k].to = joint.to;
        states[k].turn = joint.turn;
    }
}

// The base of every branch, from the joints of all its ancestors.
@compute @workgroup_size(64)
fn carry_limbs(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&limbs)) {
        return;
    }
    var to = vec3f(0.0);
    var turn = REST;
    var at = k;
    for (var parent = limbs[k].parent; parent >= 0; parent = limbs[at].parent) {
        to = states[at].to + rotate(states[at].turn, select(limbs[at].offset, vec3f(0.0), at == k) + to);
        turn = after(states[at].turn, turn);
        at = u32(parent);
    }
    states[k].base_to = limbs[at].root + to;
    states[k].base_turn = turn;
}

// The motion of every section, and the box around what it carries.
@compute @workgroup_size(64)
fn seat_sections(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&seats)) {
        return;
    }
    let seat = seats[k];
    let moved = own(seat.limb, seat.share, seat.piece);
    let base = states[seat.limb].base_turn;
    let from_base = limbs[seat.limb].offset + moved.to + rotate(moved.turn, seat.offset);
    let to = states[seat.limb].base_to + rotate(base, from_base);
    var turn = after(base, moved.turn);
    //#if TURNS
    let half_turn = 0.5 * turns[k];
    turn = after(turn, vec4f(seat.axis * sin(half_turn), cos(half_turn)));
    //#endif
    let texel = vec2u(3u * (k % SECTIONS_WIDE), k / SECTIONS_WIDE);
    textureStore(sections, texel, vec4f(seat.point, 0.0));
    textureStore(sections, texel + vec2u(1u, 0u), vec4f(to, 0.0));
    textureStore(sections, texel + vec2u(2u, 0u), turn);
    let rest = at_rest[k];
    if (rest.carries == 0.0) {
        boxes[k] = Box(vec3f(NOWHERE), vec3f(-NOWHERE));
        return;
    }
    let centre = to + rotate(turn, rest.centre - seat.point);
    let sides = abs(rotate(turn, rest.x)) + abs(rotate(turn, rest.y)) + abs(rotate(turn, rest.z));
    // Vertices are rounded where they are drawn.
    let around = sides + 1e-6 * abs(centre);
    boxes[k] = Box(centre - around, centre + around);
}

// The box around everything that a branch carries: its bark and its leaves.
@compute @workgroup_size(64)
fn unite_parts(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&limbs)) {
        return;
    }
    var all = Box(vec3f(NOWHERE), vec3f(-NOWHERE));
    for (var n = 0u; n < limbs[k].members; n++) {
        let one = boxes[members[limbs[k].first_member + n]];
        all = Box(min(all.low, one.low), max(all.high, one.high));
    }
    parts[k] = all;
}
