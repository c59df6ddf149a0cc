// A lawn on a hill: the twin of `hill.rs` in the room `fit_grass`. Blades stand upright on the hill, so that upright
// slices are crossed where they are over level ground, at another height. The ground and the level slice are searched
// for between two crossings.

//#if HILL
// Halvings of a piece of a ray in which one value is, and pieces of a ray that are in the lawn one after the other,
// where the ray leaves it over a ridge.
const HILL_HALVINGS: u32 = 20u;
const HILL_PIECES: u32 = 4u;

fn hill_rise(at: vec2f) -> f32 {
    let apart = at - vec2f(grass.rays[0].w, grass.rays[1].w);
    return grass.rays[2].w * exp(-dot(apart, apart) * grass.below.w);
}

fn hill_slope(at: vec2f) -> vec2f {
    return (vec2f(grass.rays[0].w, grass.rays[1].w) - at) * (2.0 * grass.below.w * hill_rise(at));
}

// The box ends below the ground, so that every ray through the ground passes it within the box.
fn hill_low() -> f32 {
    return min(grass.rays[2].w, 0.0) - 0.1 * grass.base.w;
}

fn hill_high() -> f32 {
    return max(grass.rays[2].w, 0.0) + grass.base.w;
}

// A direction at a place, relative to the ground there.
fn sheared(d: vec3f, at: vec2f) -> vec3f {
    return vec3f(d.xy, d.z - dot(hill_slope(at), d.xy));
}

// A point with its height over the ground.
fn hill_over(p: vec3f) -> vec3f {
    return vec3f(p.xy, p.z - hill_rise(p.xy));
}

// How fast a ray's height over the ground changes.
fn hill_falling(eye: vec3f, d: vec3f, t: f32) -> f32 {
    return sheared(d, eye.xy + t * d.xy).z;
}

// Where a ray comes down to the height `over` over the ground: `start` where it is below this height there, FAR where
// it does not come down to it before `end`. Along a ray, the height over the ground is a straight line less a
// Gaussian, whose second derivative has two zeros: one standard deviation to each side of the place where the ray is
// nearest to the hill's axis. Between them, the height falls or rises evenly, or it has one lowest or one highest
// place. So it is split into pieces that only fall or only rise, of which none can hide a crossing.
fn hill_down(eye: vec3f, d: vec3f, start: f32, end: f32, over: f32) -> f32 {
    if (hill_over(eye + start * d).z <= over) {
        return start;
    }
    let across = dot(d.xy, d.xy);
    let nearest = dot(vec2f(grass.rays[0].w, grass.rays[1].w) - eye.xy, d.xy) / max(across, 1e-12);
    let away = inverseSqrt(max(2.0 * grass.below.w * across, 1e-12));
    var ends = clamp(vec3f(nearest - away, nearest + away, end), vec3f(start), vec3f(end));
    var begin = start;
    for (var k = 0; k < 3; k++) {
        let to = ends[k];
        // The lowest or highest place of this piece, if there is one.
        var turns = to;
        let falls = hill_falling(eye, d, begin) < 0.0;
        if ((hill_falling(eye, d, to) < 0.0) != falls) {
            var a = begin;
            var b = to;
            for (var i = 0u; i < HILL_HALVINGS; i++) {
                let middle = 0.5 * (a + b);
                if ((hill_falling(eye, d, middle) < 0.0) == falls) {
                    a = middle;
                } else {
                    b = middle;
                }
            }
            turns = 0.5 * (a + b);
        }
        if (hill_over(eye + turns * d).z <= over) {
            return hill_root(eye, d, begin, turns, over);
        }
        if (hill_over(eye + to * d).z <= over) {
            return hill_root(eye, d, turns, to, over);
        }
        begin = to;
    }
    return FAR;
}

// Where the height over the ground passes `over` between two distances.
fn hill_root(origin: vec3f, d: vec3f, first: f32, last: f32, over: f32) -> f32 {
    var a = first;
    var b = last;
    let above = hill_over(origin + a * d).z > over;
    for (var i = 0u; i < HILL_HALVINGS; i++) {
        let middle = 0.5 * (a + b);
        if ((hill_over(origin + middle * d).z > over) == above) {
            a = middle;
        } else {
            b = middle;
        }
    }
    return 0.5 * (a + b);
}

// What a ray has gathered.
struct HillRay {
    seen: Both,
    left: f32,
    depth: f32,
    nearest: f32,
}

fn hill_gather(ray: ptr<function, HillRay>, c: Crossing, t: f32, d: vec3f, all: Overall) {
    let hit = struck(c, shares(d, sheared(d, c.place.xy).z), level_at(t), d, all);
    (*ray).seen.sky += (*ray).left * hit.light.sky;
    (*ray).seen.sun += (*ray).left * hit.light.sun;
    (*ray).left *= 1.0 - hit.opacity;
    if (hit.opacity > 0.0 && (*ray).nearest < 0.0) {
        (*ray).nearest = t;
    }
    if ((*ray).left <= 0.5 && (*ray).depth < 0.0) {
        (*ray).depth = t;
    }
}

//#if SAMPLE_MASK
// The samples of a pixel that blades of this opacity cover before the sky. In the mean over 4 x 4 pixels, they are
// the share that the opacity says: Bayer's matrix rounds up or down. Which ones they are turns from pixel to pixel,
// so that no sample is preferred.
fn covering(opacity: f32, at: vec2f) -> u32 {
    let p = vec2u(at) & vec2u(3u);
    let low = p & vec2u(1u);
    let high = p >> vec2u(1u);
    let order = 4u * (2u * (low.x ^ low.y) + low.y) + 2u * (high.x ^ high.y) + high.y;
    let count = u32(4.0 * opacity + (f32(order) + 0.5) / 16.0);
    let some = ((1u << min(count, 4u)) - 1u) << (order & 3u);
    return (some | (some >> 4u)) & 15u;
}
//#endif

//#if !BILLBOARDS
@fragment
fn grass_fragment(@builtin(position) position: vec4f) -> GrassOut {
    let eye = frame.eye.xyz - grass.base.xyz;
    let d = normalize(grass.rays[0].xyz + position.x * grass.rays[1].xyz + position.y * grass.rays[2].xyz);
    let low = vec3f(grass.corners.xy, hill_low());
    let high = vec3f(grass.corners.zw, hill_high());
    let ahead = d > vec3f(0.0);
    let enters = select((select(high, low, ahead) - eye) / d, vec3f(-FAR), d == vec3f(0.0));
    let leaves = select((select(low, high, ahead) - eye) / d, vec3f(FAR), d == vec3f(0.0));
    let end = min(leaves.x, min(leaves.y, leaves.z));
    var start = max(0.0, max(enters.x, max(enters.y, enters.z)));
    let all = overall();
    var ray = HillRay(Both(vec3f(0.0), vec3f(0.0)), 1.0, -1.0, -1.0);
    // The distance at which the ray reaches the ground, and the one at which it was cut off.
    var ground = -1.0;
    var cut = -1.0;
    var steps = 0u;
    for (var piece = 0u; piece < HILL_PIECES && ground < 0.0 && cut < 0.0 && ray.left >= STOPPED; piece++) {
        let first = hill_down(eye, d, start, end, grass.base.w);
        if (first >= end) {
            break;
        }
        start = end;
        let origin = eye + first * d;
        var walk = walk_from(origin, d, NOTHING, 0);
        walk.half = FAR;
        walk.end = end - first;
        var last = 0.0;
        var was = hill_over(origin).z;
        // An eye below the ground sees nothing of the lawn.
        if (was < -0.01 * grass.base.w) {
            break;
        }
        loop {
            var c = following(&walk);
            let next = min(c.t, walk.end);
            let place = hill_over(origin + next * d);
            //#if LEVEL_SLICE
            let half = 0.5 * grass.base.w;
            if ((was > half) != (place.z > half)) {
                let t = hill_root(origin, d, last, next, half);
                let level = hill_over(origin + t * d);
                hill_gather(&ray, Crossing(t, ACROSS_Z, 0, level), first + t, d, all);
            }
            //#endif
            if (place.z < 0.0) {
                ground = first + hill_root(origin, d, last, next, 0.0);
                break;
            }
            if (c.across == NOTHING || ray.left < STOPPED) {
                break;
            }
            if (steps >= STEPS) {
                cut = first + next;
                break;
            }
            if (place.z > grass.base.w) {
                if (sheared(d, place.xy).z > 0.0) {
                    // The ray leaves the lawn over a ridge, and may come into it again.
                    start = first + next;
                    break;
                }
            } else {
                c.place = place;
                hill_gather(&ray, c, first + next, d, all);
                steps++;
            }
            last = next;
            was = place.z;
        }
    }
    // Rays are filled as over level ground. Where too little was gathered to fill a ray that was cut off, the ground
    // is seen. A ray that leaves the lawn over a ridge has the colour of its blades on as many samples as its opacity
    // says.
    let opacity = 1.0 - ray.left;
    if (cut >= 0.0 && opacity < LITTLE) {
        ground = hill_down(eye, d, cut, end, 0.0);
        if (ground >= end) {
            discard;
        }
    }
    var filled = ray.left < STOPPED || (cut >= 0.0 && opacity >= LITTLE);
    //#if SAMPLE_MASK
    var samples = 15u;
    if (!filled && ground < 0.0) {
        samples = covering(opacity, position.xy);
        filled = samples != 0u;
    }
    //#else
    filled = filled || (ground < 0.0 && opacity >= 0.5);
    //#endif
    if (!filled && ground < 0.0) {
        discard;
    }
    var at = ray.depth;
    if (filled) {
        ray.seen.sky /= opacity;
        ray.seen.sun /= opacity;
        if (at < 0.0) {
            at = select(ray.nearest, cut, cut >= 0.0);
        }
    } else {
        let soil = on_soil(vec3f((eye + ground * d).xy, 0.0), level_at(ground), all);
        ray.seen.sky += ray.left * grass.soil.rgb * soil.sky;
        ray.seen.sun += ray.left * grass.soil.rgb * soil.sun;
        if (at < 0.0) {
            // The depth is slightly before the ground that the scene draws in nearly the same place: its mesh is higher
            // than the hill by 1/2300 of the hill's height at most.
            let before = max(0.02 * grass.base.w, abs(grass.rays[2].w) / 2048.0);
            at = ground - before / max(-sheared(d, (eye + ground * d).xy).z, 0.05);
        }
    }
    var out = shown_at(grass.base.xyz + eye + d * at, ray.seen);
    //#if SAMPLE_MASK
    out.samples = samples;
    //#endif
    return out;
}
//#endif
//#endif
