// Poses the branches of plants once a frame, in single precision, as `src/flora/pose` does on the CPU in double
// precision. Four passes follow each other: every branch bends in its own frame; joints sit on their parents; bases are
// carried along the hierarchy; sections follow their branches. A fifth puts boxes around what branches carry, where
// shadow maps need them. The vertex stage only looks sections up.
//
// Places on a branch are counted from its root at rest, so that they keep their digits far from the scene's origin.
// What several sections need of their branch is read once for all of them: a software adapter spends more time on
// reading a number from a buffer than on computing with it.

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
    // Its seats.
    first_seat: u32,
    seats: u32,
    unused: u32,
}

struct Piece {
    place: vec3f,
    begin: f32,
    way: vec3f,
    unused: f32,
}

// The beginning of a piece on the bent branch, or its tip: its place, its places along and across the bent beam, the
// cosine of the beam's turn there, and its share.
struct Mark {
    place: vec3f,
    along: f32,
    across: f32,
    cosine: f32,
    begin: f32,
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
    //#if HANGS
    // From the branch's axis to the section's point, and the unit vector about which it turns there.
    offset: vec3f,
    axis: vec3f,
    //#endif
    // Along the branch: 0 at the root, 1 at the tip.
    share: f32,
    // The number of the section that sits there.
    section: u32,
}

// Seats on one piece of a branch that follow each other.
struct Run {
    limb: u32,
    // Counted from the branch's first one.
    piece: u32,
    first: u32,
    count: u32,
}

// A box with any axes, whose half sides are x, y and z.
struct Oriented {
    // From the section's point at rest.
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
// The seats of each branch follow each other, those of each of its pieces too.
@group(0) @binding(2) var<storage, read> seats: array<Seat>;
@group(0) @binding(3) var<storage, read> amplitudes: array<vec2f>;
// The angle by which each section turns about its seat's axis.
@group(0) @binding(4) var<storage, read> turns: array<f32>;
// The boxes around what the section of each seat carries at rest.
@group(0) @binding(5) var<storage, read> at_rest: array<Oriented>;
@group(0) @binding(6) var<storage, read> runs: array<Run>;
// Those of branch k begin at its first piece plus k: one for each piece, and one for the tip.
@group(0) @binding(7) var<storage, read_write> marks: array<Mark>;
@group(0) @binding(8) var<storage, read_write> states: array<State>;
@group(0) @binding(9) var<storage, read_write> parts: array<Box>;
// Two for each section: the place that its point moves to, and a quaternion.
@group(0) @binding(10) var<storage, read_write> sections: array<vec4f>;

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

// About where the share x of a branch stands along its bent beam (`plant::length::bend`).
fn about(limb: Limb, x: f32, amplitude: f32) -> f32 {
    let straight = polynomial(limb.a, coordinate(limb.alpha, limb.ln_alpha, x));
    let du = amplitude * straight.y / (((1.0 - x) + limb.alpha * x) * limb.ell);
    let root = sqrt(1.0 + du * du);
    return x - amplitude * straight.x * du / ((1.0 + root) * root);
}

// The same between two marks, where the beam goes along by the cosine of its turn.
fn between(a: Mark, b: Mark, x: f32) -> f32 {
    let h = b.begin - a.begin;
    let u = (x - a.begin) / max(h, 1e-9);
    let v = 1.0 - u;
    let from_a = (1.0 + 2.0 * u) * a.along + u * h * a.cosine;
    let from_b = (1.0 + 2.0 * v) * b.along - v * h * b.cosine;
    return v * v * from_a + u * u * from_b;
}

// Where the share x of a branch stands on its bent beam: along, across, and the cosine and sine of its turn.
// `along` is about the first of them.
fn bend(limb: Limb, x: f32, amplitude: f32, along: f32) -> vec4f {
    var nodes = array<vec2f, 6>(
        vec2f(0.033765243, 0.085662246), vec2f(0.16939531, 0.18038079), vec2f(0.38069041, 0.23395697),
        vec2f(0.61930959, 0.23395697), vec2f(0.83060469, 0.18038079), vec2f(0.96623476, 0.085662246));
    let alpha = limb.alpha;
    let ln_alpha = limb.ln_alpha;
    let ell = limb.ell;
    let a = limb.a;
    var y = coordinate(alpha, ln_alpha, clamp(along, 0.0, 1.0));
    for (var step = 0u; step < STEPS; step++) {
        var extra = 0.0;
        for (var n = 0u; n < 6u; n++) {
            let v = y * nodes[n].x;
            let on = exp(v * ln_alpha) * ell;
            let up = amplitude * polynomial(a, v).y;
            extra += nodes[n].y * up * up / (sqrt(on * on + up * up) + on);
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
fn gone(limb: Limb, piece: Piece, x: f32, e: vec3f, earlier: vec2f, later: vec2f) -> vec3f {
    let t = limb.t;
    let b = cross(t, e);
    let d = later - earlier;
    let within = dot(piece.way, t) * (d.x * t + d.y * e) + dot(piece.way, e) * (d.x * e - d.y * t);
    return limb.length * (within + dot(piece.way, b) * (x - piece.begin) * b);
}

fn direction(limb: Limb, amplitude: vec2f) -> vec3f {
    let size = length(amplitude);
    return select(limb.r, (amplitude.x * limb.r + amplitude.y * cross(limb.t, limb.r)) / size, size > 0.0);
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
    let limb = limbs[k];
    let e = direction(limb, amplitude);
    let first = limb.first_piece;
    var piece = pieces[first];
    var place = piece.place;
    var before = vec2f(0.0);
    for (var n = 0u; n <= limb.pieces; n++) {
        let next = pieces[first + min(n, limb.pieces - 1u)];
        let x = select(1.0, next.begin, n < limb.pieces);
        let bent = bend(limb, x, size, about(limb, x, size));
        if (n > 0u) {
            place += gone(limb, piece, x, e, before, bent.xy);
        }
        piece = next;
        before = bent.xy;
        marks[first + k + n] = Mark(place, bent.x, bent.y, bent.z, x);
    }
}

struct Rigid {
    // From the branch's root.
    to: vec3f,
    turn: vec4f,
}

// What the cross-sections on a piece of a branch have in common, and the marks of its ends.
struct On {
    limb: Limb,
    piece: Piece,
    begin: Mark,
    end: Mark,
    amplitude: vec2f,
}

fn on_piece(k: u32, number: u32) -> On {
    let limb = limbs[k];
    let piece = limb.first_piece + number;
    return On(limb, pieces[piece], marks[piece + k], marks[piece + k + 1u], states[k].amplitude);
}

// The cross-section at the share x of a branch, before the base moves it.
fn own(on: On, x: f32) -> Rigid {
    let limb = on.limb;
    let size = length(on.amplitude);
    if (size == 0.0) {
        return Rigid(on.piece.place + on.piece.way * ((x - on.piece.begin) * limb.length), REST);
    }
    let e = direction(limb, on.amplitude);
    //#if CLOSED_FORM
    let along = about(limb, x, size);
    //#else
    let along = between(on.begin, on.end, x);
    //#endif
    let bent = bend(limb, x, size, along);
    let to = on.begin.place + gone(limb, on.piece, x, e, vec2f(on.begin.along, on.begin.across), bent.xy);
    // Half the turn in the plane of t and e.
    let cosine = sqrt(0.5 + 0.5 * bent.z);
    return Rigid(to, vec4f(cross(limb.t, e) * (0.5 * bent.w / cosine), cosine));
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
        let joint = own(on_piece(u32(parent), limbs[k].parent_piece), limbs[k].at);
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

// The motion of every section.
@compute @workgroup_size(64)
fn seat_sections(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= arrayLength(&runs)) {
        return;
    }
    let run = runs[id.x];
    let on = on_piece(run.limb, run.piece);
    let base_to = states[run.limb].base_to;
    let base_turn = states[run.limb].base_turn;
    for (var n = run.first; n < run.first + run.count; n++) {
        let seat = seats[n];
        let moved = own(on, seat.share);
        var from_base = on.limb.offset + moved.to;
        var turn = after(base_turn, moved.turn);
        //#if HANGS
        from_base += rotate(moved.turn, seat.offset);
        let half_turn = 0.5 * turns[seat.section];
        turn = after(turn, vec4f(seat.axis * sin(half_turn), cos(half_turn)));
        //#endif
        sections[2u * seat.section] = vec4f(base_to + rotate(base_turn, from_base), 0.0);
        sections[2u * seat.section + 1u] = turn;
    }
}

// The box around everything that a branch carries: its bark and its leaves.
@compute @workgroup_size(64)
fn enclose_parts(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&limbs)) {
        return;
    }
    let first = limbs[k].first_seat;
    var all = Box(vec3f(NOWHERE), vec3f(-NOWHERE));
    for (var n = first; n < first + limbs[k].seats; n++) {
        let rest = at_rest[n];
        if (rest.carries == 0.0) {
            continue;
        }
        let section = 2u * seats[n].section;
        let turn = sections[section + 1u];
        let centre = sections[section].xyz + rotate(turn, rest.centre);
        let sides = abs(rotate(turn, rest.x)) + abs(rotate(turn, rest.y)) + abs(rotate(turn, rest.z));
        // Vertices are rounded where they are drawn.
        let around = sides + 1e-6 * abs(centre);
        all = Box(min(all.low, centre - around), max(all.high, centre + around));
    }
    parts[k] = all;
}
