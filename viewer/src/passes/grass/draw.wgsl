// A fragment's ray through the lawn.

//#if !BILLBOARDS
struct GrassOut {
    @location(0) colour: vec4f,
    @builtin(frag_depth) depth: f32,
    //#if SAMPLE_MASK
    @builtin(sample_mask) samples: u32,
    //#endif
}

//#if !HILL
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
    return shown_at(grass.base.xyz + origin + d * at, seen);
}
//#endif

// What a fragment shows, and its depth at a place in the world.
fn shown_at(world: vec3f, light: Both) -> GrassOut {
    var seen = light;
    var radiance = seen.sky;
    //#if SUN
    //#if SHADOW
    //#if HILL
    // The ground casts shadows too. A point on it is lifted by more than two texels of their map.
    seen.sun *= visibility(world, frame.sun_direction.xyz, 0.0);
    //#else
    seen.sun *= visibility(world, frame.sun_direction.xyz, 1.0);
    //#endif
    //#endif
    radiance += seen.sun;
    //#endif
    let clip = frame.view_projection * vec4f(world, 1.0);
    var out: GrassOut;
    out.colour = held(radiance);
    out.depth = clamp(clip.z / clip.w, 0.0, 1.0);
    //#if SAMPLE_MASK
    out.samples = 15u;
    //#endif
    return out;
}
//#endif
