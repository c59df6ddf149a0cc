// Light that arrives at a point past and by way of other surfaces, interpolated between the anchors of its leaf: the
// irradiance vectors of both sides, and harmonics for gloss. `transfer.wgsl` works out the rows.

//#if TRANSFER
// What arrives at the pixel, whatever its maps say there: x, y and z of the front's irradiance vector, then the back's.
var<private> vectors: array<vec3f, 6>;
//#if ALBEDO
// The harmonics, normalisation folded in.
var<private> harmonics: array<vec3f, 49>;
//#endif

fn arrive(first: u32, place: vec2f) {
    let last = vec2u(GRID_X - 1u, GRID_Y - 1u);
    let at = clamp(place, vec2f(0.0), vec2f(last));
    let low = min(vec2u(at), last);
    let high = min(low + 1u, last);
    let t = at - vec2f(low);
    let around = first + ROWS * (vec4u(low.x, high.x, low.x, high.x) + GRID_X * vec4u(low.y, low.y, high.y, high.y));
    let weights = vec4f((1.0 - t.x) * (1.0 - t.y), t.x * (1.0 - t.y), (1.0 - t.x) * t.y, t.x * t.y);
    for (var k = 0u; k < 6u; k++) {
        vectors[k] = between(around + k, weights);
    }
    //#if ALBEDO
    for (var k = 0u; k < BANDS * BANDS; k++) {
        harmonics[k] = between(around + 6u + k, weights);
    }
    //#endif
}

fn between(rows: vec4u, weights: vec4f) -> vec3f {
    return weights.x * arriving[rows.x].rgb + weights.y * arriving[rows.y].rgb
        + weights.z * arriving[rows.z].rgb + weights.w * arriving[rows.w].rgb;
}

// Irradiance over π on the side whose rows begin at `side`, for this normal.
fn collected(normal: vec3f, side: u32) -> vec3f {
    let sum = normal.x * vectors[side] + normal.y * vectors[side + 1u] + normal.z * vectors[side + 2u];
    return max(vec3f(0.0), sum) * 0.318309886;
}
//#endif
