// Grass as slices (Habel 2009, ch. 2). A ray through a box over the ground crosses upright slices across x and across
// y, and a level slice at half the height. A formula gives the crossings, closest first (Eq. 2.1–2.3). This is the twin
// of `march.rs` in the room `fit_grass`, in single precision. It is part of the main pass and uses the lights of
// `light.wgsl`.

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
    soil: vec4f,
    scatter: vec4f,
    // Radiance below the horizon that the sky's harmonics contain.
    below: vec4f,
    // The ray through a place (x, y) of the picture is the first + x · the second + y · the third.
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
    let local = mix(vec3f(grass.corners.xy, 0.0), vec3f(grass.corners.zw, grass.base.w), far);
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
    let wanted = table(PROJECTION, d.z);
    let upright = grass.shown.x * (abs(d.x) + abs(d.y));
    let w = part(wanted, upright);
    return vec2f(w, part(wanted - w * upright, grass.shown.y * abs(d.z)));
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

// The progress of a ray through the slices: the next slices across x and y, the distance to the level one (FAR if it
// was crossed or is absent), and the distance to the end.
struct Walk {
    origin: vec3f,
    d: vec3f,
    next: vec2i,
    half: f32,
    end: f32,
}

struct Crossing {
    t: f32,
    across: u32,
    index: i32,
    place: vec3f,
}

fn steps_apart() -> vec2f {
    return grass.period.xy / grass.period.z;
}

// Distance to the ray's last point in the box. The origin is inside the box.
fn way_out(origin: vec3f, d: vec3f) -> f32 {
    let edge = select(vec3f(grass.corners.xy, 0.0), vec3f(grass.corners.zw, grass.base.w), d > vec3f(0.0));
    let t = select((edge - origin) / d, vec3f(FAR), d == vec3f(0.0));
    return max(0.0, min(t.x, min(t.y, t.z)));
}

// The walk from a point on the slice `index` across `across`, or on no slice (NOTHING).
fn walk_from(origin: vec3f, d: vec3f, across: u32, index: i32) -> Walk {
    // The plane with the number j lies (j + 1/2) steps from the rectangle's edge.
    let x = (origin.xy + 0.5 * grass.period.xy) / steps_apart() - 0.5;
    var next = vec2i(select(ceil(x) - 1.0, floor(x) + 1.0, d.xy > vec2f(0.0)));
    let ahead = select(vec2i(-1), vec2i(1), d.xy > vec2f(0.0));
    if (across == ACROSS_X) {
        next.x = index + ahead.x;
    } else if (across == ACROSS_Y) {
        next.y = index + ahead.y;
    }
    var half = FAR;
    //#if LEVEL_SLICE
    if (across != ACROSS_Z && d.z != 0.0) {
        let t = (0.5 * grass.base.w - origin.z) / d.z;
        half = select(FAR, t, t > 0.0);
    }
    //#endif
    return Walk(origin, d, next, half, way_out(origin, d));
}

// The next crossing, closest first.
fn following(walk: ptr<function, Walk>) -> Crossing {
    let d = (*walk).d;
    let plane = (vec2f((*walk).next) + 0.5) * steps_apart() - 0.5 * grass.period.xy;
    let t = select(max((plane - (*walk).origin.xy) / d.xy, vec2f(0.0)), vec2f(FAR), d.xy == vec2f(0.0));
    var found = Crossing(FAR, NOTHING, 0, vec3f(0.0));
    if ((*walk).half < min(t.x, t.y)) {
        found.t = (*walk).half;
        found.across = ACROSS_Z;
        (*walk).half = FAR;
    } else if (t.x <= t.y) {
        found.t = t.x;
        found.across = ACROSS_X;
        found.index = (*walk).next.x;
        (*walk).next.x += select(-1, 1, d.x > 0.0);
    } else {
        found.t = t.y;
        found.across = ACROSS_Y;
        found.index = (*walk).next.y;
        (*walk).next.y += select(-1, 1, d.y > 0.0);
    }
    if (!(found.t < (*walk).end)) {
        found.across = NOTHING;
    }
    found.place = (*walk).origin + d * found.t;
    return found;
}

// A layer of a slice's sheet at a crossing.
fn sliced(crossing: Crossing, layer: i32, level: f32) -> vec4f {
    let along = fract(crossing.place.xy / grass.period.xy + 0.5);
    //#if LEVEL_SLICE
    if (crossing.across == ACROSS_Z) {
        let at = grass.level.z + vec2f(along.x, 1.0 - along.y) * grass.level.xy;
        let size = vec2f(textureDimensions(level_slice, 0));
        return textureSampleLevel(level_slice, slice_sampler, at / size, layer, level);
    }
    //#endif
    let count = i32(grass.period.z);
    // The remainder is computed by floor, because % differs between shading languages for negative numbers.
    var cell = crossing.index - count * i32(floor((f32(crossing.index) + 0.5) / grass.period.z));
    var u = along.y;
    if (crossing.across == ACROSS_Y) {
        cell += count;
        u = along.x;
    }
    let columns = i32(grass.upright.w);
    let corner = vec2f(f32(cell % columns), f32(cell / columns)) * (grass.upright.xy + 2.0 * grass.upright.z);
    let v = clamp(crossing.place.z / grass.base.w, 0.0, 1.0);
    let at = corner + grass.upright.z + vec2f(u, 1.0 - v) * grass.upright.xy;
    let size = vec2f(textureDimensions(upright_slices, 0));
    return textureSampleLevel(upright_slices, slice_sampler, at / size, layer, level);
}

// Share of the light from `to` that passes all slices ahead.
fn passing(start: Walk, to: vec3f, level: f32) -> f32 {
    let weight = weights(to);
    var walk = start;
    var left = 1.0;
    for (var i = 0u; i < STEPS; i++) {
        let c = following(&walk);
        if (c.across == NOTHING || left < STOPPED) {
            break;
        }
        let w = select(weight.x, weight.y, c.across == ACROSS_Z);
        left *= 1.0 - counted(c.across, c.place.z / grass.base.w, w) * sliced(c, 0, level).w;
    }
    return left;
}

// Share of the light from `to` that arrives at the part of a slice that a ray along d sees. `within` is the place of
// the blade in the slab (0 to 1).
fn arriving_at(crossing: Crossing, within: f32, d: vec3f, to: vec3f, level: f32) -> f32 {
    let weight = weights(to);
    let steps = steps_apart();
    var place = crossing.place;
    let behind = 1.0 - within;
    var ahead = 0.0;
    var w = weight.x;
    if (crossing.across == ACROSS_X) {
        place.x -= sign(d.x) * (0.5 - behind) * steps.x;
        ahead = select(0.0, within, d.x * to.x > 0.0);
    } else if (crossing.across == ACROSS_Y) {
        place.y -= sign(d.y) * (0.5 - behind) * steps.y;
        ahead = select(0.0, within, d.y * to.y > 0.0);
    } else {
        place.z -= sign(d.z) * (0.5 - behind) * grass.base.w;
        ahead = select(behind, within, d.z * to.z > 0.0);
        w = weight.y;
    }
    let height = place.z / grass.base.w;
    var left = 1.0;
    if (ahead > 0.0) {
        left -= covered(crossing.across, height) * counted(crossing.across, height, w * ahead);
    }
    return left * passing(walk_from(place, to, crossing.across, crossing.index), to, level);
}

// Irradiance over π by the sky above the horizon.
fn from_above(normal: vec3f) -> vec3f {
    //#if DOME
    return max(vec3f(0.0), even_light(normal) - grass.below.rgb * (0.5 - 0.5 * normal.z));
    //#else
    //#if SKY
    return frame.sky.rgb * (0.5 + 0.5 * normal.z);
    //#else
    return vec3f(0.0);
    //#endif
    //#endif
}

// Mean radiance of the blades around a height. `first` is the irradiance over π that they get on both sides. The result
// contains what they scatter of it, and what they scatter of each other's light.
fn around(height: f32, first: vec3f) -> vec3f {
    let seen = 1.0 - 0.5 * table(OPEN, height);
    return 0.5 * grass.scatter.rgb * first / max(vec3f(1.0) - grass.scatter.rgb * seen, vec3f(1e-3));
}

// Light of the sky and of the sun. They are gathered separately, because other things in the scene may still shade the
// sun.
struct Both {
    sky: vec3f,
    sun: vec3f,
}

// Values that are the same for a whole lawn: the sky's light on level ground, and the share of the sun's light that
// blades get.
struct Overall {
    overhead: vec3f,
    scattered: f32,
}

fn overall() -> Overall {
    var to_sun = frame.sun_direction.xyz;
    //#if WIND
    to_sun = normalize(unleant(to_sun, grass.lean.xy));
    //#endif
    return Overall(from_above(vec3f(0.0, 0.0, 1.0)), table(PROJECTION, to_sun.z));
}

// Level of detail of the sheets at a distance from the eye.
fn level_at(distance: f32) -> f32 {
    return max(0.0, log2(distance * grass.shown.w / (grass.period.x / grass.upright.x)));
}

// The opacity of a slice for a ray, and the light that the slice adds.
struct Struck {
    opacity: f32,
    light: Both,
}

// Evaluates a slice at a crossing. d is the ray's direction in the lawn without wind.
fn struck(
    c: Crossing,
    weight: vec2f,
    level: f32,
    d: vec3f,
    all: Overall,
    //#if WIND
    leans: vec2f,
    //#endif
) -> Struck {
    var out = Struck(0.0, Both(vec3f(0.0), vec3f(0.0)));
    let w = select(weight.x, weight.y, c.across == ACROSS_Z);
    let height = c.place.z / grass.base.w;
    let share = counted(c.across, height, w);
    if (share <= 0.0) {
        return out;
    }
    let what = sliced(c, 0, level);
    if (what.w <= 0.0) {
        return out;
    }
    out.opacity = share * what.w;
    // The side that the ray sees follows from the blades' normals, not from the slice's.
    let faces = dot(what.xyz, d) < 0.0;
    var turned = what.xyz;
    //#if WIND
    turned.z -= dot(leans, turned.xy);
    //#endif
    let reflects = sliced(c, select(2, 1, faces), level);
    let lets_through = sliced(c, 3, level).rgb;
    let normal = select(-turned, turned, faces) / max(length(turned), 1e-20);
    // The level slice shows blades of all heights, so the height comes from the blade's place in the slab.
    let stands = select(height, reflects.w / what.w, c.across == ACROSS_Z);
    let opens = table(OPEN, stands);
    let both = share * (reflects.rgb + lets_through);
    //#if SKY
    out.light.sky = share * opens * (reflects.rgb * from_above(normal) + lets_through * from_above(-normal));
    out.light.sky += both * (1.0 - 0.5 * opens) * around(stands, opens * all.overhead);
    //#endif
    //#if SUN
    let to = frame.sun_direction.xyz;
    // The ground hides a sun that is at the horizon or below it.
    if (to.z > 0.0) {
        let cosine = dot(normal, to);
        var own_to = to;
        //#if WIND
        own_to = unleant(to, leans);
        //#endif
        let arrives = arriving_at(c, reflects.w / what.w, d, own_to, level);
        let e = frame.sun_irradiance.rgb * 0.318309886;
        out.light.sun = share * select(lets_through, reflects.rgb, cosine > 0.0) * abs(cosine) * arrives * e;
        out.light.sun += both * (1.0 - 0.5 * opens) * around(stands, e * all.scattered * table(SUNLIT, stands));
    }
    //#endif
    return out;
}

// Light on the ground under the blades, over π.
fn on_soil(place: vec3f, level: f32, all: Overall) -> Both {
    var soil = Both(mix(around(0.0, entry(OPEN, 0u) * all.overhead), all.overhead, grass.shown.z), vec3f(0.0));
    //#if SUN
    let to = frame.sun_direction.xyz;
    if (to.z > 0.0) {
        let e = frame.sun_irradiance.rgb * 0.318309886;
        var own_to = to;
        //#if WIND
        own_to = unleant(to, leaning(place.xy));
        //#endif
        soil.sun = e * to.z * passing(walk_from(place, own_to, NOTHING, 0), own_to, level);
        soil.sun += (1.0 - grass.shown.z) * around(0.0, e * all.scattered * entry(SUNLIT, 0u));
    }
    //#endif
    return soil;
}

//#if BILLBOARDS
// A board, or the whole ground, as a polygon.
struct Board {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) which: vec2i,
    @location(1) place: vec3f,
}

// The vertices of a board. `board` holds the axis that its slice stands across (NOTHING for the ground), the number of
// its plane, the number of the interval between planes of the other axis, and whether it is the upper half.
@vertex
fn board_vertex(@builtin(vertex_index) corner: u32, @location(0) board: vec4i) -> Board {
    let apart = steps_apart();
    let plane = (vec2f(board.yz) + 0.5) * apart - 0.5 * grass.period.xy;
    let end = vec2f(f32(corner & 1u), f32(corner >> 1u));
    let half = 0.5 * grass.base.w;
    var p = vec3f(mix(grass.corners.xy, grass.corners.zw, end), 0.01 * grass.base.w);
    if (board.x == i32(ACROSS_X)) {
        p = vec3f(plane.x, plane.y + end.x * apart.y, half * (f32(board.w) + end.y));
    } else if (board.x == i32(ACROSS_Y)) {
        let along = (f32(board.z) + 0.5 + end.x) * apart.x - 0.5 * grass.period.x;
        p = vec3f(along, (f32(board.y) + 0.5) * apart.y - 0.5 * grass.period.y, half * (f32(board.w) + end.y));
    } else if (board.x == i32(ACROSS_Z)) {
        p = vec3f(plane + end * apart, half);
    }
    p = vec3f(clamp(p.xy, grass.corners.xy, grass.corners.zw), p.z);
    return Board(frame.view_projection * vec4f(grass.base.xyz + p, 1.0), board.xy, p);
}

@fragment
fn board_fragment(board: Board) -> @location(0) vec4f {
    let ray = board.place - (frame.eye.xyz - grass.base.xyz);
    let d = normalize(ray);
    let level = level_at(length(ray));
    let all = overall();
    var hit = Struck(1.0, Both(vec3f(0.0), vec3f(0.0)));
    if (board.which.x == i32(NOTHING)) {
        hit.light = on_soil(vec3f(board.place.xy, 0.0), level, all);
        hit.light.sky *= grass.soil.rgb;
        hit.light.sun *= grass.soil.rgb;
    } else {
        let c = Crossing(0.0, u32(board.which.x), board.which.y, board.place);
        hit = struck(c, weights(d), level, d, all);
    }
    var radiance = hit.light.sky;
    //#if SUN
    //#if SHADOW
    hit.light.sun *= visibility(grass.base.xyz + board.place, frame.sun_direction.xyz, 1.0);
    //#endif
    radiance += hit.light.sun;
    //#endif
    return vec4f(held(radiance).rgb, hit.opacity);
}
//#else
struct GrassOut {
    @location(0) colour: vec4f,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn grass_fragment(@builtin(position) position: vec4f) -> GrassOut {
    let eye = frame.eye.xyz - grass.base.xyz;
    let d = normalize(grass.rays[0].xyz + position.x * grass.rays[1].xyz + position.y * grass.rays[2].xyz);
    // Where the ray enters the box. An eye inside the grass is already in it.
    let near = select(vec3f(grass.corners.zw, grass.base.w), vec3f(grass.corners.xy, 0.0), d > vec3f(0.0));
    let enters = select((near - eye) / d, vec3f(-FAR), d == vec3f(0.0));
    let first = max(0.0, max(enters.x, max(enters.y, enters.z)));
    let low = vec3f(grass.corners.xy, 0.0);
    let high = vec3f(grass.corners.zw, grass.base.w);
    let origin = clamp(eye + first * d, low, high);
    let end = way_out(origin, d);
    // The ray in the lawn without wind: it is sheared by the wind's lean at the place where the ray enters.
    var begins = origin;
    var along = d;
    //#if WIND
    let lean = leaning(origin.xy);
    begins = unleant(origin, lean);
    along = unleant(d, lean);
    //#endif
    let weight = weights(along);
    let all = overall();

    var walk = walk_from(begins, along, NOTHING, 0);
    walk.end = end;
    var left = 1.0;
    var seen = Both(vec3f(0.0), vec3f(0.0));
    var depth = -1.0;
    // The distance at which the ray was cut off although there were more slices ahead.
    var cut = -1.0;
    // One step more than STEPS finds out whether there are more slices.
    for (var i = 0u; i <= STEPS; i++) {
        var c = following(&walk);
        if (c.across == NOTHING) {
            break;
        }
        if (i == STEPS) {
            cut = c.t;
            break;
        }
        var own = d;
        //#if WIND
        // Look-ups are sheared by the difference between the lean here and the lean where the ray entered.
        let leans = leaning(origin.xy + d.xy * c.t);
        let within = vec2<bool>(c.across == ACROSS_X, c.across == ACROSS_Y);
        c.place -= vec3f(select(c.place.z * (leans - lean), vec2f(0.0), within), 0.0);
        own = unleant(d, leans);
        //#endif
        let level = level_at(first + c.t);
        //#if WIND
        let hit = struck(c, weight, level, own, all, leans);
        //#else
        let hit = struck(c, weight, level, own, all);
        //#endif
        if (hit.opacity <= 0.0) {
            continue;
        }
        seen.sky += left * hit.light.sky;
        seen.sun += left * hit.light.sun;
        left *= 1.0 - hit.opacity;
        if (left <= 0.5 && depth < 0.0) {
            depth = c.t;
        }
        if (left < STOPPED) {
            break;
        }
    }

    // A ray that was cut off is filled with the mean colour of the blades that it gathered. A ray that leaves the lawn
    // on its side is filled in the same way if blades stopped more than half of its light. Behind any other ray is the
    // ground, or nothing of the lawn.
    let ground = d.z < 0.0 && abs(origin.z + d.z * end) < 1e-3 * grass.base.w;
    let opacity = 1.0 - left;
    var at = depth;
    let filled = left < STOPPED || (cut >= 0.0 && opacity >= LITTLE) || (!ground && opacity >= 0.5);
    if (!filled && !ground) {
        discard;
    }
    if (filled) {
        seen.sky /= opacity;
        seen.sun /= opacity;
        if (at < 0.0) {
            at = cut;
        }
    } else {
        let place = origin + d * end;
        let soil = on_soil(place, level_at(first + end), all);
        seen.sky += left * grass.soil.rgb * soil.sky;
        seen.sun += left * grass.soil.rgb * soil.sun;
        if (at < 0.0) {
            // The depth is slightly before the ground that the scene draws in the same place.
            at = end - 0.01 * grass.base.w / max(-d.z, 0.05);
        }
    }
    let world = grass.base.xyz + origin + d * at;
    var radiance = seen.sky;
    //#if SUN
    //#if SHADOW
    seen.sun *= visibility(world, frame.sun_direction.xyz, 1.0);
    //#endif
    radiance += seen.sun;
    //#endif
    let clip = frame.view_projection * vec4f(world, 1.0);
    return GrassOut(held(radiance), clamp(clip.z / clip.w, 0.0, 1.0));
}
//#endif
