// A leaf: evaluates its maps on either side by the formulas of `scene.rs`.

struct LeafConstants {
    // x: mean thickness h (mm), y: refractive index.
    leaf: vec4f,
    // Slab curves: x is the least thickness (mm), y the number of points for each mm, z the index of the last point.
    front_curve: vec4f,
    back_curve: vec4f,
    // Rows of the albedo tables: x is ln of the smallest m, y is 1/ln(m_max/m_min).
    albedo: vec4f,
}

@group(1) @binding(0) var<uniform> constants: LeafConstants;
//#if SAMPLED
@group(1) @binding(1) var map_sampler: sampler;
//#endif
//#if MASK
@group(1) @binding(2) var mask: texture_2d<f32>;
//#endif
//#if ALBEDO
@group(1) @binding(3) var albedo_table: texture_2d<f32>;
//#if DOME
@group(1) @binding(4) var lobe_means: texture_2d<f32>;
//#endif
//#endif

struct Pixel {
    @location(0) radiance: vec4f,
    //#if SAMPLE_MASK
    @builtin(sample_mask) samples: u32,
    //#endif
}

//#if LIT
//#if SUN
// Sunlight that comes through from the far side, times π and per irradiance: max(0, F·l)·ρt. Translucency maps replace
// the cosine, or both factors.
fn through(place: Place, facing: Facing, light: vec3f, transmittance: vec3f) -> vec3f {
    //#if TRANSLUCENCY
    let axes = facing.axes;
    // The light's direction in the front's frame.
    //#if BENT
    // The direction at which the bent functions are evaluated: x and y multiplied by (2|z|/(1+|z|))^¼.
    let height = abs(dot(axes.normal, light));
    let bend = sqrt(sqrt(2.0 * height / (1.0 + height)));
    let omega = vec3f(bend * dot(axes.tangent, light), bend * dot(axes.bitangent, light), dot(axes.normal, light));
    //#else
    let omega = vec3f(dot(axes.tangent, light), dot(axes.bitangent, light), dot(axes.normal, light));
    //#endif
    //#endif
    //#if BACK_TRANSLUCENCY
    if (facing.front) {
        return back_through(place, omega, transmittance);
    }
    //#endif
    //#if FRONT_TRANSLUCENCY
    if (!facing.front) {
        return front_through(place, omega, transmittance);
    }
    //#endif
    //#if !FRONT_TRANSLUCENCY || !BACK_TRANSLUCENCY
    //#if TANGENT
    let far = mapped(!facing.front, place, facing.axes);
    //#else
    let far = -facing.towards_viewer;
    //#endif
    return max(0.0, dot(far, light)) * transmittance;
    //#else
    return vec3f(0.0);
    //#endif
}
//#endif

//#if GLOSS
//#if SUN
// The sun's highlight, per irradiance across its rays, and the cosine at which they arrive.
fn highlight(normal: vec3f, gloss: vec4f, view: vec3f) -> vec4f {
    let light = frame.sun_direction.xyz;
    let cosine = max(0.0, dot(normal, light));
    return vec4f(cosine * gloss.rgb * lobe(normal, light, view, max(gloss.a, 1e-3)), cosine);
}

//#if SUPERSAMPLE
// The mean of highlight and cosine over the pixel: see `side.wgsl`. Diffuse sunlight is mean cosine times mean
// reflectance. The sky's light is that of the mean normal, with which it changes slowly.
fn mean_highlight(place: Place, facing: Facing, normal: vec3f, gloss: vec4f) -> vec4f {
    if (facing.front) {
        return front_mean_highlight(place, facing, normal, gloss);
    }
    return back_mean_highlight(place, facing, normal, gloss);
}
//#endif
//#endif
//#endif

// The light that the surface sends to the viewer.
fn shade(place: Place, facing: Facing, world: vec3f) -> vec3f {
    var out = vec3f(0.0);
    let view = facing.view;
    // N is the viewed side's mapped normal. The far side's normal F is looked up only where the sun or a dome needs
    // it.
    //#if TANGENT
    let viewed = mapped(facing.front, place, facing.axes);
    //#else
    let viewed = facing.towards_viewer;
    //#endif
    //#if GLOSS
    let gloss = gloss_at(facing.front, place);
    //#endif
    //#if SKY
    let reflectance = reflectance_at(facing.front, place);
    let transmittance = transmittance_at(!facing.front, place);
    //#if DOME
    //#if TANGENT
    let away = mapped(!facing.front, place, facing.axes);
    //#else
    let away = -facing.towards_viewer;
    //#endif
    //#if TRANSFER
    let near = select(3u, 0u, facing.front);
    out = reflectance * collected(viewed, near) + transmittance * collected(away, 3u - near);
    //#else
    out = reflectance * even_light(viewed) + transmittance * even_light(away);
    //#endif
    //#if ALBEDO
    let roughness = max(gloss.a, 1e-3);
    out += gloss.rgb * albedo(dot(viewed, view), roughness) * glossy_light(viewed, view, roughness);
    //#endif
    //#else
    var scattered = reflectance + transmittance;
    //#if ALBEDO
    scattered += gloss.rgb * albedo(dot(viewed, view), max(gloss.a, 1e-3));
    //#endif
    out = frame.sky.rgb * scattered;
    //#endif
    //#endif
    //#if SUN
    // Shadow maps are read only where sunlight would be seen. In full shadow, no map is read for the sun's highlight.
    let light = frame.sun_direction.xyz;
    let cosine = dot(light, facing.flat_normal);
    if (cosine > 0.0) {
        let sun = sunlight(facing, world);
        if (max(sun.r, max(sun.g, sun.b)) > 0.0) {
            //#if !SKY
            let reflectance = reflectance_at(facing.front, place);
            //#endif
            //#if GLOSS
            //#if SUPERSAMPLE
            let shine = mean_highlight(place, facing, viewed, gloss);
            //#else
            let shine = highlight(viewed, gloss, view);
            //#endif
            out += sun * (shine.a * reflectance * 0.318309886 + shine.rgb);
            //#else
            out += sun * max(0.0, dot(viewed, light)) * reflectance * 0.318309886;
            //#endif
        }
    } else if (cosine < 0.0) {
        //#if !SKY
        let transmittance = needed_transmittance(!facing.front, place);
        //#endif
        if (lets_through(!facing.front, transmittance)) {
            let sun = sunlight(facing, world);
            if (max(sun.r, max(sun.g, sun.b)) > 0.0) {
                out += sun * through(place, facing, light, transmittance) * 0.318309886;
            }
        }
    }
    //#endif
    return out;
}

//#if SCANNER
fn scanned(place: Place, facing: Facing, world: vec3f) -> vec3f {
    //#if TANGENT
    let normal = mapped(facing.front, place, facing.axes);
    //#else
    let normal = facing.towards_viewer;
    //#endif
    let reflectance = reflectance_at(facing.front, place);
    //#if GLOSS
    let gloss = gloss_at(facing.front, place);
    return under_tube(Scanned(normal, reflectance, gloss.rgb, max(gloss.a, 1e-3)), facing.view, world);
    //#else
    return under_tube(Scanned(normal, reflectance), facing.view, world);
    //#endif
}
//#endif

//#endif

@fragment
fn fragment(in: Varying, @builtin(front_facing) front_facing: bool) -> Pixel {
    var out: Pixel;
    // Derivatives must be taken before the outline discards anything.
    let across = cross(dpdx(world_of(in)), dpdy(world_of(in)));
    //#if TRANSFER
    // Distance between neighbouring pixels in anchors. The smaller of the two counts, which on a leaf seen edge-on is
    // that along the leaf.
    let passed = min(length(dpdx(in.place)), length(dpdy(in.place)));
    //#endif
    let dx = dpdx(in.uv);
    let dy = dpdy(in.uv);
    //#if MASK
    //#if SAMPLE_MASK
    // The four standard sample positions, in pixels from the centre. Coverage is then the same as four rays would find.
    var samples = 0u;
    var offsets = array<vec2f, 4>(vec2f(-0.125, -0.375), vec2f(0.375, -0.125), vec2f(-0.375, 0.125), vec2f(0.125,
        0.375));
    for (var i = 0u; i < 4u; i++) {
        let uv = in.uv + dx * offsets[i].x + dy * offsets[i].y;
        if (textureSampleLevel(mask, map_sampler, uv, 0.0).r >= 0.5) {
            samples |= 1u << i;
        }
    }
    out.samples = samples;
    if (samples == 0u) {
        discard;
    }
    //#else
    if (textureSampleLevel(mask, map_sampler, in.uv, 0.0).r < 0.5) {
        discard;
    }
    //#endif
    //#endif
    var radiance = vec3f(0.0);
    //#if LIT
    //#if TRANSFER
    arrive(in.first, in.place, passed);
    //#endif
    let place = Place(in.uv, vec2f(1.0 - in.uv.x, in.uv.y), dx, dy);
    let facing = faced(in, front_facing, across);
    radiance = shade(place, facing, world_of(in));
    //#if SCANNER
    radiance += scanned(place, facing, world_of(in));
    //#endif
    //#endif
    out.radiance = held(radiance);
    return out;
}
