// Poses the branches of plants once a frame, in single precision, as `src/models/plants/pose` does on the CPU in double
// precision: every branch bends in its own frame; joints sit on their parents; bases are carried along the hierarchy;
// sections follow their branches. Where shadow maps need them, boxes are put around what branches carry. The vertex
// stage only looks sections up. `rigid.wgsl` and `beam.wgsl` stand before this file. After it stands the file with the
// passes: `pose_alone.wgsl` or `pose_groups.wgsl`.
//
// Places on a branch are counted from its root at rest, so that they keep their digits far from the scene's origin.
// What several sections need of their branch is read once for all of them, in rows of four numbers: a software adapter
// needs about as long to read them as to compute with them.

// A branch as it is stored.
struct Stored {
    // t and α, and r.
    t: vec4f,
    r: vec4f,
    // The coefficients of the deflection.
    a: vec4f,
    // The length, ln α/(α − 1), the share of the parent's axis where the branch grows, and ln α.
    sizes: vec4f,
    root: vec4f,
    // The root from the place on the parent's axis where the branch grows, at rest.
    offset: vec4f,
    // The parent (−1 for none), the piece of the parent there, the first own piece, and the number of own pieces.
    pieces: vec4i,
    // The first of its seats, their number, and how many of them, the first ones, are on marks.
    seats: vec4u,
}

struct Piece {
    // The place where it begins, and the share.
    begin: vec4f,
    way: vec4f,
}

// The beginning of a piece on the bent branch, or its tip.
struct Mark {
    // The place, and the share.
    place: vec4f,
    // The places along and across the bent beam, and the cosine and sine of the beam's turn there.
    beam: vec4f,
}

// What a branch does at this time.
struct State {
    // Where the root is, from the parent's root, and how the branch has turned there, before the parent's base moves
    // both.
    to: vec3f,
    turn: vec4f,
    // The base: where the root is in the scene, and how the branch has turned there.
    base_to: vec3f,
    base_turn: vec4f,
    // The unit vector across the branch towards which it bends, at rest, and the amplitude.
    bends: vec4f,
}

// Where a section sits on its branch.
struct Seat {
    //#if HANGS
    // From the branch's axis to the section's point, and the unit vector about which it turns there.
    offset: vec3f,
    axis: vec3f,
    //#endif
    // The bits of the share: 0 at the root, 1 at the tip. For a seat on a mark, the number of the mark on the branch.
    place: u32,
    // The number of the section that sits there.
    section: u32,
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

@group(0) @binding(0) var<storage, read> limbs: array<Stored>;
@group(0) @binding(1) var<storage, read> pieces: array<Piece>;
// The seats of each branch follow each other: first those on marks, then the others in the order of its pieces.
//#if HANGS
// The bits of offset and place, and of axis and section.
@group(0) @binding(2) var<storage, read> seats: array<array<vec4u, 2>>;
//#else
// The place, and the section.
@group(0) @binding(2) var<storage, read> seats: array<vec2u>;
//#endif
@group(0) @binding(3) var<storage, read> amplitudes: array<vec2f>;
// The angle by which each section turns about its seat's axis.
@group(0) @binding(4) var<storage, read> turns: array<f32>;
// The boxes around what the section of each seat carries at rest.
@group(0) @binding(5) var<storage, read> at_rest: array<Oriented>;
// Seats on a branch that follow each other, each on the same piece as the one before or on the next: the branch, the
// piece of the first seat, the first seat, and their number.
@group(0) @binding(6) var<storage, read> runs: array<vec4u>;
// Those of branch k begin at its first piece plus k: one for each piece, and one for the tip.
@group(0) @binding(7) var<storage, read_write> marks: array<Mark>;
@group(0) @binding(8) var<storage, read_write> states: array<State>;
@group(0) @binding(9) var<storage, read_write> parts: array<Box>;
@group(0) @binding(10) var<storage, read_write> sections: array<array<vec4f, 2>>;

const REST = vec4f(0.0, 0.0, 0.0, 1.0);
// The corners of an empty box.
const NOWHERE = 1e30;

fn limb_of(k: u32) -> Limb {
    let t = limbs[k].t;
    let sizes = limbs[k].sizes;
    return Limb(t.xyz, t.w, sizes.w, limbs[k].a, sizes.x, sizes.y);
}

fn seat_of(n: u32) -> Seat {
    //#if HANGS
    let offset = seats[n][0];
    let axis = seats[n][1];
    return Seat(bitcast<vec3f>(offset.xyz), bitcast<vec3f>(axis.xyz), offset.w, axis.w);
    //#else
    let seat = seats[n];
    return Seat(seat.x, seat.y);
    //#endif
}

// The rotation `b`, and then `a`.
fn after(a: vec4f, b: vec4f) -> vec4f {
    return vec4f(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
}

// How far the axis goes from the beginning of a piece to the share x of the bent branch (`Swung::end`).
fn gone(limb: Limb, way: vec3f, begin: f32, x: f32, e: vec3f, earlier: vec2f, later: vec2f) -> vec3f {
    let t = limb.t;
    let b = cross(t, e);
    let d = later - earlier;
    let within = dot(way, t) * (d.x * t + d.y * e) + dot(way, e) * (d.x * e - d.y * t);
    return limb.length * (within + dot(way, b) * (x - begin) * b);
}

// The turn of a cross-section in the plane of t and e, towards which the branch bends.
fn turned(limb: Limb, e: vec3f, bent: vec4f) -> vec4f {
    let cosine = sqrt(0.5 + 0.5 * bent.z);
    return vec4f(cross(limb.t, e) * (0.5 * bent.w / cosine), cosine);
}

// Towards which direction across a branch the wind bends it, and the amplitude.
fn bends(k: u32, limb: Limb) -> vec4f {
    let amplitude = amplitudes[k];
    let size = length(amplitude);
    let r = limbs[k].r.xyz;
    return vec4f(select(r, (amplitude.x / size) * r + (amplitude.y / size) * cross(limb.t, r), size > 0.0), size);
}

// What the cross-sections on a piece of a branch have in common, and the marks of its ends.
struct On {
    limb: Limb,
    way: vec3f,
    begin: Mark,
    end: Mark,
    bends: vec4f,
}

fn on_piece(k: u32, piece: u32) -> On {
    let mark = piece + k;
    return On(limb_of(k), pieces[piece].way.xyz, marks[mark], marks[mark + 1u], states[k].bends);
}

// The cross-section at the share x of a branch, from its root and before the base moves it.
fn own(on: On, x: f32) -> Rigid {
    let limb = on.limb;
    let size = on.bends.w;
    let begin = on.begin.place.w;
    if (size == 0.0) {
        return Rigid(on.begin.place.xyz + on.way * ((x - begin) * limb.length), REST);
    }
    let e = on.bends.xyz;
    //#if CLOSED_FORM
    let along = about(limb, x, size);
    //#else
    let along = between(on.begin, on.end, x);
    //#endif
    let bent = bend(limb, x, size, along);
    let to = on.begin.place.xyz + gone(limb, on.way, begin, x, e, on.begin.beam.xy, bent.xy);
    return Rigid(to, turned(limb, e, bent));
}

// Writes the section of a seat whose cross-section moves so before the base moves it.
fn seated(base: Rigid, moved: Rigid, seat: Seat) {
    var from_base = moved.to;
    var turn = after(base.turn, moved.turn);
    //#if HANGS
    from_base += rotate(moved.turn, seat.offset);
    let half_turn = 0.5 * turns[seat.section];
    turn = after(turn, vec4f(seat.axis * sin(half_turn), cos(half_turn)));
    //#endif
    sections[seat.section][0] = vec4f(base.to + rotate(base.turn, from_base), 0.0);
    sections[seat.section][1] = turn;
}

// The root of a branch on its parent, before the parent's base moves it.
fn joint(k: u32) -> Rigid {
    let parent = vec2u(limbs[k].pieces.xy);
    let on = own(on_piece(parent.x, parent.y), limbs[k].sizes.z);
    return Rigid(on.to + rotate(on.turn, limbs[k].offset.xyz), on.turn);
}

// The box around what the section of a seat carries; an empty one where it carries nothing.
fn around(n: u32) -> Box {
    let rest = at_rest[n];
    if (rest.carries == 0.0) {
        return Box(vec3f(NOWHERE), vec3f(-NOWHERE));
    }
    let moved = moved_by(seat_of(n).section);
    let centre = moved.to + rotate(moved.turn, rest.centre);
    let turn = moved.turn;
    let sides = abs(rotate(turn, rest.x)) + abs(rotate(turn, rest.y)) + abs(rotate(turn, rest.z));
    // Vertices are rounded where they are drawn.
    let half = sides + 1e-6 * abs(centre);
    return Box(centre - half, centre + half);
}
