// Light that arrives at a point between and by way of other surfaces, interpolated between the anchors of its leaf. It
// consists of the irradiance vectors of both sides, and of harmonics for gloss. `transfer.wgsl` computes the rows.

//#if TRANSFER
// The light that arrives at the pixel, whatever its maps say: x, y and z of the front's irradiance vector, then the
// back's.
var<private> vectors: array<vec3f, 6>;
//#if ALBEDO
// The harmonics. They contain their normalisation.
var<private> harmonics: array<vec3f, 49>;
//#endif

// Where two anchors are fewer pixels apart than this, coarser anchors are mixed in. At half this distance the finer
// ones no longer count.
const NEAR: f32 = 4.0;

// Number of anchors along a piece and across it on a level.
fn grid_of(level: u32) -> vec2u {
    return max(vec2u(GRID_X, GRID_Y) >> vec2u(level), vec2u(1u));
}

// `begin` is the first row of the instance, whose four highest bits are the level of its first anchors, and the piece.
// `passed` is the distance between neighbouring pixels in anchors.
fn arrive(begin: vec2u, place: vec2f, passed: f32) {
    let kept = begin.x >> 28u;
    let wanted = clamp(log2(max(passed * NEAR, 1e-6)), f32(kept), f32(ANCHOR_LEVELS - 1u));
    let fine = u32(wanted);
    var first = begin.x & 0x0fffffffu;
    for (var level = kept; level < fine; level++) {
        let grid = grid_of(level);
        first += PIECES * grid.x * grid.y * ROWS;
    }
    let coarse = wanted - f32(fine);
    add(fine, first, begin.y, place, 1.0 - coarse);
    if (coarse > 0.0) {
        let grid = grid_of(fine);
        add(fine + 1u, first + PIECES * grid.x * grid.y * ROWS, begin.y, place, coarse);
    }
}

// Adds a share of the light by the anchors of one level, whose rows begin with `first`.
fn add(level: u32, first: u32, piece: u32, place: vec2f, share: f32) {
    let grid = grid_of(level);
    let last = grid - 1u;
    let fine = vec2f(max(vec2u(GRID_X, GRID_Y), vec2u(2u)) - 1u);
    let at = clamp(place * (vec2f(last) / fine), vec2f(0.0), vec2f(last));
    let low = min(vec2u(at), last);
    let high = min(low + 1u, last);
    let t = at - vec2f(low);
    let start = first + piece * grid.x * grid.y * ROWS;
    let around = start + ROWS * (vec4u(low.x, high.x, low.x, high.x) + grid.x * vec4u(low.y, low.y, high.y, high.y));
    let weights = share * vec4f((1.0 - t.x) * (1.0 - t.y), t.x * (1.0 - t.y), (1.0 - t.x) * t.y, t.x * t.y);
    for (var k = 0u; k < 6u; k++) {
        vectors[k] += between(around + k, weights);
    }
    //#if ALBEDO
    for (var k = 0u; k < BANDS * BANDS; k++) {
        harmonics[k] += between(around + 6u + k, weights);
    }
    //#endif
}

fn between(rows: vec4u, weights: vec4f) -> vec3f {
    return weights.x * arriving[rows.x].rgb + weights.y * arriving[rows.y].rgb
        + weights.z * arriving[rows.z].rgb + weights.w * arriving[rows.w].rgb;
}

// Irradiance over π on a surface with this normal, on the side whose rows begin at `side`.
fn collected(normal: vec3f, side: u32) -> vec3f {
    let sum = normal.x * vectors[side] + normal.y * vectors[side + 1u] + normal.z * vectors[side + 2u];
    return max(vec3f(0.0), sum) * 0.318309886;
}
//#endif
