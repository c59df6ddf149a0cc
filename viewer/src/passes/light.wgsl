// How light meets a surface: the lobe, the sun's visible share, the lobe's albedo and what it collects of the sky's
// harmonics. Part of the main pass.

//#if SUN || SCANNER
//#if GLOSS
// f_s per unit ρs; 0 where the half vector lies below the surface.
fn lobe(normal: vec3f, light: vec3f, view: vec3f, roughness: f32) -> f32 {
    let h = normalize(light + view);
    let nh = dot(normal, h);
    let nl = dot(normal, light);
    let nv = max(dot(normal, view), 1e-3);
    let vh = dot(view, h);
    if (nh <= 0.0 || nl <= 0.0 || vh <= 0.0) {
        return 0.0;
    }
    let m2 = roughness * roughness;
    // sin²α from the cross product: 1 − cos²α would lose its digits near the mirror direction.
    let across = cross(normal, h);
    let cos2 = nh * nh;
    let tan2 = dot(across, across) / cos2;
    //#if GGX
    let density = m2 / (3.14159265 * cos2 * cos2 * (m2 + tan2) * (m2 + tan2));
    //#else
    let density = exp(-tan2 / m2) / (3.14159265 * m2 * cos2 * cos2);
    //#endif
    //#if SCANNER
    let cavity = select(1.0, min(1.0, 2.0 * nh * min(nv, nl) / vh), frame.travel.y > 0.5);
    //#else
    let cavity = min(1.0, 2.0 * nh * min(nv, nl) / vh);
    //#endif
    var f = density * cavity / (4.0 * nl * nv);
    //#if FRESNEL
    let n = constants.leaf.y;
    let t = sqrt(1.0 - (1.0 - min(vh, 1.0) * min(vh, 1.0)) / (n * n));
    let s_wave = (vh - n * t) / (vh + n * t);
    let p_wave = (n * vh - t) / (n * vh + t);
    f *= 0.5 * (s_wave * s_wave + p_wave * p_wave);
    //#endif
    return f;
}
//#endif

//#if SHADOW
// Share of the sun's disk that is seen from a point: the mean over the shadow maps, each a 2×2 comparison. The point is
// lifted off its surface by as much as the depth can change within the filter's reach, so that a leaf does not shadow
// itself.
fn visibility(world: vec3f, normal_to_sun: vec3f, cosine: f32) -> f32 {
    let sine = sqrt(max(0.0, 1.0 - cosine * cosine));
    //#if LEVELS
    // Drawn and cast by different levels of detail: off by as much as the two may be apart, too.
    let lifted = vec4f(world + normal_to_sun * (frame.shadow.x * (0.3 + 2.0 * sine) + frame.shadow.y), 1.0);
    //#else
    let lifted = vec4f(world + normal_to_sun * (frame.shadow.x * (0.3 + 2.0 * sine)), 1.0);
    //#endif
    var seen = 0.0;
    for (var i = 0u; i < SHADOW_LAYERS; i++) {
        let p = (shadow_matrices[i] * lifted).xyz;
        seen += textureSampleCompareLevel(shadow_map, shadow_sampler, vec2f(0.5 + 0.5 * p.x, 0.5 - 0.5 * p.y), i, p.z);
    }
    return seen / f32(SHADOW_LAYERS);
}
//#endif
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
    let high = mix(textureLoad(albedo_table, i + vec2i(0, 1), 0).r, textureLoad(albedo_table, i + vec2i(1, 1), 0).r, t.x);
    return mix(low, high, t.y);
}
//#endif

//#if DOME
// Σ w_l c_lm Y_lm(d), not below 0: p_mm = 1, (l−m) p_l = (2l−1) z p_{l−1} − (l+m−1) p_{l−2}, times the parts of (x +
// iy)^m.
fn gathered(d: vec3f, weight: array<f32, 7>) -> vec3f {
    var w = weight;
    var sum = vec3f(0.0);
    var turn = vec2f(1.0, 0.0);
    for (var m = 0; m < 7; m++) {
        var before = 0.0;
        var p = 1.0;
        for (var l = m; l < 7; l++) {
            let at = l * (l + 1);
            var part = turn.x * dome[at + m].rgb;
            if (m > 0) {
                part += turn.y * dome[at - m].rgb;
            }
            sum += w[l] * p * part;
            let next = (f32(2 * l + 1) * d.z * p - f32(l + m) * before) / f32(l + 1 - m);
            before = p;
            p = next;
        }
        turn = vec2f(turn.x * d.x - turn.y * d.y, turn.x * d.y + turn.y * d.x);
    }
    return max(sum, vec3f(0.0));
}

// Irradiance over π on a surface with this normal: the cosine lobe's bands are 1, 2/3, 1/4, 0, −1/24, 0, 1/64 of π.
fn even_light(normal: vec3f) -> vec3f {
    return gathered(normal, array<f32, 7>(1.0, 2.0 / 3.0, 0.25, 0.0, -1.0 / 24.0, 0.0, 1.0 / 64.0));
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

// Mean radiance that the lobe collects: its bands about its mean direction.
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
