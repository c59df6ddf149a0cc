// How light meets a surface: the visible share of the sun, the lobe's albedo, the light that it collects from the sky's
// harmonics, and a scanner's tube. It is part of the main pass. The lobe itself is in `lobe.wgsl`.

//#if SHADOW
// Share of the sun's disk that is seen from a point: the mean over the shadow maps, with a 2×2 comparison in each. The
// point is lifted off its surface by the largest change of depth within the filter's reach, so that a leaf does not
// shadow itself.
fn visibility(world: vec3f, normal_to_sun: vec3f, cosine: f32) -> f32 {
    let sine = sqrt(max(0.0, 1.0 - cosine * cosine));
    //#if LEVELS
    // The drawn surface and the one in the shadow maps have different levels of detail. So the point is also lifted by
    // the largest distance between the two.
    let lifted = vec4f(world + normal_to_sun * (frame.shadow.x * (0.3 + 2.0 * sine) + frame.shadow.y), 1.0);
    //#else
    let lifted = vec4f(world + normal_to_sun * (frame.shadow.x * (0.3 + 2.0 * sine)), 1.0);
    //#endif
    var seen = 0.0;
    for (var i = 0u; i < SHADOW_LAYERS; i++) {
        let p = (shadow_matrices[i] * lifted).xyz;
        // Beside the map nothing casts a shadow. Beyond its depth, everything in the map casts one.
        let place = vec2f(0.5 + 0.5 * p.x, 0.5 - 0.5 * p.y);
        let within = all(place >= vec2f(0.0)) && all(place <= vec2f(frame.shadow.z));
        let open = textureSampleCompareLevel(shadow_map, shadow_sampler, place, i, min(p.z, 0.999999));
        seen += select(1.0, open, within);
    }
    return seen / f32(SHADOW_LAYERS);
}
//#endif

//#if ALBEDO
// a(N·v, m): bilinear in √(N·v) and ln m.
fn albedo(nv: f32, roughness: f32) -> f32 {
    let size = vec2f(textureDimensions(albedo_table));
    let first = sqrt(1e-3);
    let x = (sqrt(clamp(nv, 1e-3, 1.0)) - first) / (1.0 - first);
    let y = clamp((log(roughness) - constants.albedo.x) * constants.albedo.y, 0.0, 1.0);
    let p = vec2f(x, y) * (size - 1.0);
    let i = min(vec2i(p), vec2i(size) - 2);
    let t = p - vec2f(i);
    let low = mix(textureLoad(albedo_table, i, 0).r, textureLoad(albedo_table, i + vec2i(1, 0), 0).r, t.x);
    let high = mix(textureLoad(albedo_table, i + vec2i(0, 1), 0).r, textureLoad(albedo_table, i + vec2i(1, 1), 0).r,
        t.x);
    return mix(low, high, t.y);
}
//#endif

//#if DOME
// Coefficient k of the light, which contains its normalisation.
fn coefficient(k: i32) -> vec3f {
    //#if TRANSFER
    //#if ALBEDO
    return harmonics[k];
    //#else
    return vec3f(0.0);
    //#endif
    //#else
    return dome[k].rgb;
    //#endif
}

//#if ALBEDO
fn means(place: vec2f, row: f32) -> vec4f {
    let i = min(vec2i(place), vec2i(94, 22));
    let t = place - vec2f(i);
    let j = i + vec2i(0, i32(row));
    let low = mix(textureLoad(lobe_means, j, 0), textureLoad(lobe_means, j + vec2i(1, 0), 0), t.x);
    let high = mix(textureLoad(lobe_means, j + vec2i(0, 1), 0), textureLoad(lobe_means, j + vec2i(1, 1), 0), t.x);
    return mix(low, high, t.y);
}

// Mean radiance that the lobe collects, by its bands about its mean direction.
fn glossy_light(normal: vec3f, view: vec3f, roughness: f32) -> vec3f {
    let nv = dot(normal, view);
    let first = sqrt(1e-3);
    let x = (sqrt(clamp(nv, 1e-3, 1.0)) - first) / (1.0 - first);
    let y = clamp((log(roughness) - constants.albedo.x) * constants.albedo.y, 0.0, 1.0);
    let place = vec2f(x * 95.0, y * 23.0);
    let a = means(place, 0.0);
    let b = means(place, 24.0);
    let along = nv * normal - view;
    let direction = normalize(a.x * along + a.y * normal);
    return gathered(direction, array<f32, 7>(1.0, a.z, a.w, b.x, b.y, b.z, b.w));
}
//#endif
//#endif

//#if SCANNER
const TUBE_NODES: i32 = 160;

// The properties of a scanned surface: mapped normal, diffuse reflectance and gloss.
struct Scanned {
    normal: vec3f,
    reflectance: vec3f,
    //#if GLOSS
    gloss: vec3f,
    roughness: f32,
    //#endif
}

// Radiance under the tube, by midpoints along it and four Gauss points across it.
fn under_tube(surface: Scanned, view: vec3f, world: vec3f) -> vec3f {
    // Coordinates along the travel and along the tube.
    let turned = frame.travel.x > 0.5;
    let own = select(world.xy, world.yx, turned);
    let away = frame.tube.x - own.x;
    let distance = length(vec2f(away, frame.tube.w));
    let theta = atan2(away, frame.tube.w);
    let beta = asin(min(frame.tube.z / distance, 1.0));
    let low = atan((-frame.tube.y - own.y) / distance);
    let high = atan((frame.tube.y - own.y) / distance);
    var across = array<vec2f, 4>(
        vec2f(-0.861136312, 0.347854845), vec2f(-0.339981044, 0.652145155), vec2f(0.339981044, 0.652145155),
            vec2f(0.861136312, 0.347854845));
    var sum = vec3f(0.0);
    for (var i = 0; i < TUBE_NODES; i++) {
        let phi = mix(low, high, (f32(i) + 0.5) / f32(TUBE_NODES));
        let c = cos(phi);
        let s = sin(phi);
        for (var k = 0; k < 4; k++) {
            let t = theta + beta * across[k].x;
            let local = vec3f(sin(t) * c, s, cos(t) * c);
            let light = select(local, local.yxz, turned);
            let nl = dot(surface.normal, light);
            if (nl > 0.0) {
                var f = surface.reflectance * 0.318309886;
                //#if GLOSS
                f += surface.gloss * lobe(surface.normal, light, view, surface.roughness);
                //#endif
                sum += across[k].y * c * nl * f;
            }
        }
    }
    let spread = select(1.0 / distance, beta / max(frame.tube.z, 1e-6), frame.tube.z > 0.0);
    return sum * (spread * frame.tube.w * (high - low) / f32(TUBE_NODES));
}
//#endif
