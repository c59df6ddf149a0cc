// The light that a slice and the ground under the blades send to the eye.

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
        var arrives = 0.0;
        //#if HILL
        // The slope hides a sun that is behind it.
        own_to = sheared(to, c.place.xy);
        if (own_to.z > 0.0) {
            let own_d = sheared(d, c.place.xy);
            arrives = arriving_at(c, reflects.w / what.w, own_d, own_to, shares(to, own_to.z), level);
        }
        //#else
        arrives = arriving_at(c, reflects.w / what.w, d, own_to, weights(own_to), level);
        //#endif
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
        var cosine = to.z;
        //#if HILL
        own_to = sheared(to, place.xy);
        cosine = max(own_to.z, 0.0) * inverseSqrt(1.0 + dot(hill_slope(place.xy), hill_slope(place.xy)));
        let weight = shares(to, own_to.z);
        //#else
        let weight = weights(own_to);
        //#endif
        if (cosine > 0.0) {
            soil.sun = e * cosine * passing(walk_from(place, own_to, NOTHING, 0), weight, level);
        }
        soil.sun += (1.0 - grass.shown.z) * around(0.0, e * all.scattered * entry(SUNLIT, 0u));
    }
    //#endif
    return soil;
}
