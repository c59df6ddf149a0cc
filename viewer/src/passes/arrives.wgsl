// Light that arrives at a point past and by way of other surfaces, interpolated between the anchors of its leaf: the
// irradiance vectors of both sides, and harmonics for gloss. `transfer.wgsl` works out the rows.

//#if TRANSFER
// Rows of the four anchors around the pixel, and their weights.
var<private> around: vec4u;
var<private> weights: vec4f;

fn find_anchors(first: u32, place: vec2f) {
    let last = vec2u(GRID_X - 1u, GRID_Y - 1u);
    let at = clamp(place, vec2f(0.0), vec2f(last));
    let low = min(vec2u(at), last);
    let high = min(low + 1u, last);
    let t = at - vec2f(low);
    around = first + ROWS * (vec4u(low.x, high.x, low.x, high.x) + GRID_X * vec4u(low.y, low.y, high.y, high.y));
    weights = vec4f((1.0 - t.x) * (1.0 - t.y), t.x * (1.0 - t.y), (1.0 - t.x) * t.y, t.x * t.y);
}

fn row(k: u32) -> vec3f {
    return weights.x * arriving[around.x + k].rgb + weights.y * arriving[around.y + k].rgb
        + weights.z * arriving[around.z + k].rgb + weights.w * arriving[around.w + k].rgb;
}

// Irradiance over π on the side whose rows begin at `side`, for this normal.
fn collected(normal: vec3f, side: u32) -> vec3f {
    let sum = normal.x * row(side) + normal.y * row(side + 1u) + normal.z * row(side + 2u);
    return max(vec3f(0.0), sum) * 0.318309886;
}
//#endif
