// The walk of a ray through the slices, and the share of light that passes them.

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

//#if IRREGULAR
// Every rectangle shows the meadow moved by a random number of these parts of its sides.
const SHIFTS: f32 = 8.0;

// How many parts a rectangle is moved by, along x and along y. The hash is pcg3d of the rectangle and the seed
// (Jarzynski and Olano 2020), of whose numbers the highest bits count.
fn shifted(rectangle: vec2f) -> vec2f {
    let at = bitcast<vec2u>(vec2i(rectangle + vec2f(grass.soil.w, grass.scatter.w)));
    var v = vec3u(at, IRREGULAR_SEED) * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> vec3u(16u);
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    return vec2f(((v.xy >> vec2u(16u)) * u32(SHIFTS)) >> vec2u(16u));
}
//#endif

// A layer of a slice's sheet at a crossing.
fn sliced(crossing: Crossing, layer: i32, level: f32) -> vec4f {
    let place = crossing.place.xy / grass.period.xy + 0.5;
    var along = fract(place);
    var index = crossing.index;
    //#if IRREGULAR
    // A slice is in the rectangle that its number says, and in the one where it is crossed along its length.
    var rectangle = floor(place);
    if (crossing.across == ACROSS_X) {
        rectangle.x = floor((f32(index) + 0.5) / grass.period.z);
    } else if (crossing.across == ACROSS_Y) {
        rectangle.y = floor((f32(index) + 0.5) / grass.period.z);
    }
    let moved = shifted(rectangle) / SHIFTS;
    along = fract(along + moved);
    index += i32(round(grass.period.z * select(moved.y, moved.x, crossing.across == ACROSS_X)));
    //#endif
    //#if LEVEL_SLICE
    if (crossing.across == ACROSS_Z) {
        let at = grass.level.z + vec2f(along.x, 1.0 - along.y) * grass.level.xy;
        let size = vec2f(textureDimensions(level_slice, 0));
        return textureSampleLevel(level_slice, slice_sampler, at / size, layer, level);
    }
    //#endif
    let count = i32(grass.period.z);
    // The remainder is computed by floor, because % differs between shading languages for negative numbers.
    var cell = index - count * i32(floor((f32(index) + 0.5) / grass.period.z));
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

// Share of the light that passes all slices ahead, of which the shares `weight` count.
fn passing(start: Walk, weight: vec2f, level: f32) -> f32 {
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
// the blade in the slab (0 to 1), and `weight` has the shares of the slices that count along `to`. Both directions are
// relative to the lawn's ground.
fn arriving_at(crossing: Crossing, within: f32, d: vec3f, to: vec3f, weight: vec2f, level: f32) -> f32 {
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
    return left * passing(walk_from(place, to, crossing.across, crossing.index), weight, level);
}
