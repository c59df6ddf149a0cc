// The gloss lobe f_s (`src/base/surface/gloss.rs` is its twin in double precision). The name of the lobe that is drawn,
// as scenes write it, is set for the conditions below.

//#if GLOSS
//#if SUN || SCANNER
// D (1/sr), the density of the facets, from tan²α, cos²α and m².
fn facets(tan2: f32, cos2: f32, m2: f32) -> f32 {
    //#if ggx || ggx-fresnel
    return m2 / (3.14159265 * cos2 * cos2 * (m2 + tan2) * (m2 + tan2));
    //#else
    return exp(-tan2 / m2) / (3.14159265 * m2 * cos2 * cos2);
    //#endif
}

//#if cook-torrance || ggx-fresnel
// Reflectance of a dielectric of relative index `n` for unpolarised light at this cosine.
fn fresnel(cosine: f32, n: f32) -> f32 {
    let t = sqrt(1.0 - (1.0 - min(cosine, 1.0) * min(cosine, 1.0)) / (n * n));
    let s_wave = (cosine - n * t) / (cosine + n * t);
    let p_wave = (n * cosine - t) / (n * cosine + t);
    return 0.5 * (s_wave * s_wave + p_wave * p_wave);
}
//#endif

// f_s for ρs = 1; 0 where the half vector lies below the surface.
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
    let density = facets(tan2, cos2, m2);
    //#if SCANNER
    let cavity = select(1.0, min(1.0, 2.0 * nh * min(nv, nl) / vh), frame.travel.y > 0.5);
    //#else
    let cavity = min(1.0, 2.0 * nh * min(nv, nl) / vh);
    //#endif
    var f = density * cavity / (4.0 * nl * nv);
    //#if cook-torrance || ggx-fresnel
    f *= fresnel(vh, constants.leaf.y);
    //#endif
    return f;
}
//#endif
//#endif
