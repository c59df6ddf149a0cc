// Grass as slices (Habel 2009, ch. 2). A ray through a box over the ground crosses upright slices across x and across
// y, and a level slice at half the height. A formula gives the crossings, closest first (Eq. 2.1–2.3). This is the twin
// of `march.rs` in the room `fit_grass`, in single precision. It is part of the main pass and uses the lights of
// `light.wgsl`. This file has the lawn's data; `walk.wgsl`, `shade.wgsl`, `boards.wgsl` and `draw.wgsl` follow it.

struct Grass {
    // Origin in the world; w is the height.
    base: vec4f,
    // The box relative to the origin: low x, low y, high x, high y.
    corners: vec4f,
    // Period along x and y; z is the number of slices in a rectangle, w the mean opacity of the level slice.
    period: vec4f,
    // Texels of a picture along and up, texels of its border, and pictures in a line.
    upright: vec4f,
    level: vec4f,
    // Projection that slices show along the ground and from above; z is the share of the sky that the ground sees, w
    // the angle of a pixel.
    shown: vec4f,
    // The w of both: which rectangle of the lawn the origin is in, counted along x and along y.
    soil: vec4f,
    scatter: vec4f,
    // Radiance below the horizon that the sky's harmonics contain.
    // On a hill, w is 1/(2 radius²).
    below: vec4f,
    // On a hill, the w are the place of its top along x and y, and its height. The ray through a place (x, y) of the
    // picture is the first + x · the second + y · the third.
    rays: array<vec4f, 3>,
    // The mean lean of blades along x and y; zw is the place of the origin in the map of gusts.
    lean: vec4f,
    // Place in the map of gusts for each mm along x (xy) and y (zw), in sides of the map.
    turn: vec4f,
    // Four tables of 17 numbers, each padded to 20: projection, cover, open, and the share of the sun that arrives at a
    // height.
    tables: array<vec4f, 20>,
}

const PROJECTION: u32 = 0u;
const COVER: u32 = 1u;
const OPEN: u32 = 2u;
const SUNLIT: u32 = 3u;
const ACROSS_X: u32 = 0u;
const ACROSS_Y: u32 = 1u;
const ACROSS_Z: u32 = 2u;
const NOTHING: u32 = 3u;
const FAR: f32 = 1e30;
// Below this share of light that is left, a ray counts as stopped.
const STOPPED: f32 = 1e-4;
// A ray that gathered a smaller opacity than this has no colour that could represent the rest.
const LITTLE: f32 = 1e-3;

@group(1) @binding(0) var<uniform> grass: Grass;
@group(1) @binding(1) var upright_slices: texture_2d_array<f32>;
@group(1) @binding(2) var slice_sampler: sampler;
//#if LEVEL_SLICE
@group(1) @binding(3) var level_slice: texture_2d_array<f32>;
//#endif

//#if WIND
@group(1) @binding(4) var gusts: texture_2d<f32>;
@group(1) @binding(5) var gust_sampler: sampler;

// How the wind leans the lawn at a place: the displacement of a blade's point along x and y over its height.
fn leaning(place: vec2f) -> vec2f {
    let at = grass.lean.zw + place.x * grass.turn.xy + place.y * grass.turn.zw;
    return grass.lean.xy + textureSampleLevel(gusts, gust_sampler, at, 0.0).rg;
}

// A point or a direction of the leaning lawn, transformed to the lawn without wind.
fn unleant(v: vec3f, lean: vec2f) -> vec3f {
    return vec3f(v.xy - v.z * lean, v.z);
}
//#endif

// The box, with faces that are counter-clockwise from outside. The bits of a corner give its end along x, y and z.
@vertex
fn grass_vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    var faces = array<vec4u, 6>(
        vec4u(0u, 2u, 3u, 1u), vec4u(4u, 5u, 7u, 6u), vec4u(0u, 4u, 6u, 2u),
        vec4u(1u, 3u, 7u, 5u), vec4u(0u, 1u, 5u, 4u), vec4u(2u, 6u, 7u, 3u));
    var order = array<u32, 6>(0u, 1u, 2u, 0u, 2u, 3u);
    let corner = faces[index / 6u][order[index % 6u]];
    let far = vec3f(f32(corner & 1u), f32((corner >> 1u) & 1u), f32(corner >> 2u));
    var low = vec3f(grass.corners.xy, 0.0);
    var high = vec3f(grass.corners.zw, grass.base.w);
    //#if HILL
    low.z = hill_low();
    high.z = hill_high();
    //#endif
    let local = mix(low, high, far);
    return frame.view_projection * vec4f(grass.base.xyz + local, 1.0);
}

fn entry(which: u32, k: u32) -> f32 {
    let i = 20u * which + k;
    return grass.tables[i >> 2u][i & 3u];
}

// The value of a table at a share from 0 to 1, linear between its steps.
fn table(which: u32, share: f32) -> f32 {
    let x = clamp(abs(share), 0.0, 1.0) * 16.0;
    let k = min(u32(x), 15u);
    return mix(entry(which, k), entry(which, k + 1u), x - f32(k));
}

fn part(one: f32, all: f32) -> f32 {
    if (one <= 0.0) {
        return 0.0;
    }
    return select(1.0, one / all, one < all);
}

// The shares of the optical depth that count along d, for upright slices and for the level one.
fn weights(along: vec3f) -> vec2f {
    var d = along;
    //#if WIND
    d = normalize(along);
    //#endif
    return shares(d, d.z);
}

// The same along a unit vector where the height over the ground changes by `falls`. A hill lifts blades and turns none,
// so that their projection is that of the ray's own direction.
fn shares(d: vec3f, falls: f32) -> vec2f {
    let wanted = table(PROJECTION, d.z);
    let upright = grass.shown.x * (abs(d.x) + abs(d.y));
    let w = part(wanted, upright);
    return vec2f(w, part(wanted - w * upright, grass.shown.y * abs(falls)));
}

// The share of its opacity that a slice has where a share of its optical depth counts.
fn counted(across: u32, height: f32, weight: f32) -> f32 {
    let cover = covered(across, height);
    if (cover <= 0.0 || weight <= 0.0) {
        return max(weight, 0.0);
    }
    return (1.0 - pow(max(1.0 - cover, 0.0), weight)) / cover;
}

fn covered(across: u32, height: f32) -> f32 {
    return select(table(COVER, height), grass.period.w, across == ACROSS_Z);
}
