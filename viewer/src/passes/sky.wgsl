// The sky behind the leaves: Perez's all-weather formula (Perez et al. 1993) for luminance and chromaticity, combined
// as in Preetham, Shirley and Smits 1999, with the sun's disk. Below the horizon there is one colour.

struct Sky {
    // The ray of a pixel is corner + x·right + y·down.
    corner: vec4f,
    right: vec4f,
    down: vec4f,
    // Direction to the sun; w is the disk's angular radius (rad).
    sun: vec4f,
    // Radiance of the disk; w is the angle of a pixel (rad).
    disk: vec4f,
    below: vec4f,
    // Factors of the three products below: Y, Y/y and Y·x/y.
    scale: vec4f,
    // A, B, C, D and E for Y, x and y, in two vectors each.
    perez: array<vec4f, 6>,
}

@group(0) @binding(0) var<uniform> sky: Sky;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    // One triangle that covers the picture.
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

// (1 + A e^(B/cosθ)) (1 + C e^(Dγ) + E cos²γ).
fn perez(k: u32, mu: f32, gamma: f32, cosine: f32) -> f32 {
    let p = sky.perez[2u * k];
    let e = sky.perez[2u * k + 1u].x;
    return (1.0 + p.x * exp(p.y / mu)) * (1.0 + p.z * exp(p.w * gamma) + e * cosine * cosine);
}

@fragment
fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let d = normalize(sky.corner.xyz + sky.right.xyz * position.x + sky.down.xyz * position.y);
    let cosine = dot(d, sky.sun.xyz);
    let gamma = atan2(length(cross(d, sky.sun.xyz)), cosine);
    // Near the horizon the exponential is 0 long before cosθ reaches 1e-4.
    let mu = max(d.z, 1e-4);
    let y = perez(0u, mu, gamma, cosine);
    let ratio = y / perez(2u, mu, gamma, cosine);
    let s = sky.scale.xyz * vec3f(y, ratio, ratio * perez(1u, mu, gamma, cosine));
    let xyz = vec3f(s.z, s.x, s.y - s.z - s.x);
    // From XYZ to linear sRGB (IEC 61966-2-1 primaries, D65).
    var rgb = vec3f(
        dot(vec3f(3.2404542, -1.5371385, -0.4985314), xyz),
        dot(vec3f(-0.9692660, 1.8760108, 0.0415560), xyz),
        dot(vec3f(0.0556434, -0.2040259, 1.0572252), xyz));
    rgb = max(rgb, vec3f(0.0));
    // The edges of the disk and of the horizon are softened over one pixel, as multisampling does with a leaf's edges.
    rgb += sky.disk.rgb * clamp(0.5 + (sky.sun.w - gamma) / sky.disk.w, 0.0, 1.0);
    rgb = mix(sky.below.rgb, rgb, clamp(0.5 + d.z / sky.disk.w, 0.0, 1.0));
    // A 16-bit target holds at most 65504. Alpha is the leaves' coverage, so it is 0.
    return vec4f(min(rgb, vec3f(6e4)), 0.0);
}
