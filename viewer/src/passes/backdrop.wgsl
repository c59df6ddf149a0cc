// An environment map behind everything. Row 0 is at the zenith, the middle column looks to +x, and columns to the right
// of it towards -y. Texel centres lie at half steps; between them the radiance is interpolated. It wraps around in
// azimuth and is constant beyond the first and the last row.

struct Rays {
    // The ray of a pixel is corner + x·right + y·down. The last numbers are the picture's turn (whole turns), the
    // factor on its radiance, and whether there is one colour below the horizon (1) or the picture (0).
    corner: vec4f,
    right: vec4f,
    down: vec4f,
    // Direction to the sun; w is the disk's angular radius (rad).
    sun: vec4f,
    // Radiance of the disk; w is the angle of a pixel (rad).
    disk: vec4f,
    below: vec4f,
}

@group(0) @binding(0) var<uniform> rays: Rays;
@group(0) @binding(1) var map: texture_2d<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    // One triangle that covers the picture.
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

// Radiance of the picture in a direction.
fn picture(d: vec3f) -> vec3f {
    let size = vec2i(textureDimensions(map));
    let turn = 6.283185307179586;
    // An azimuth has no value at the zenith, and no influence there but for the first row's own variation.
    let azimuth = select(0.0, atan2(d.y, d.x), abs(d.x) + abs(d.y) > 0.0);
    let zenith = atan2(length(d.xy), d.z);
    let across = 0.5 - azimuth / turn + rays.corner.w;
    let at = vec2f(across * f32(size.x), zenith / (0.5 * turn) * f32(size.y)) - 0.5;
    let low = vec2i(floor(at));
    let part = at - floor(at);
    let columns = (vec2i(low.x, low.x + 1) % size.x + size.x) % size.x;
    let rows = clamp(vec2i(low.y, low.y + 1), vec2i(0), vec2i(size.y - 1));
    let upper = mix(
        textureLoad(map, vec2i(columns.x, rows.x), 0).rgb,
        textureLoad(map, vec2i(columns.y, rows.x), 0).rgb,
        part.x,
    );
    let lower = mix(
        textureLoad(map, vec2i(columns.x, rows.y), 0).rgb,
        textureLoad(map, vec2i(columns.y, rows.y), 0).rgb,
        part.x,
    );
    return mix(upper, lower, part.y);
}

@fragment
fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    // The mean of four places in the pixel, because a picture may change within a pixel.
    var rgb = vec3f(0.0);
    for (var k = 0u; k < 4u; k++) {
        let p = position.xy + vec2f(f32(k & 1u), f32(k >> 1u)) * 0.5 - 0.25;
        rgb += 0.25 * rays.right.w * picture(normalize(rays.corner.xyz + rays.right.xyz * p.x + rays.down.xyz * p.y));
    }
    let d = normalize(rays.corner.xyz + rays.right.xyz * position.x + rays.down.xyz * position.y);
    // The edges of the disk and of the horizon are softened over one pixel, as multisampling does with a leaf's edges.
    let gamma = atan2(length(cross(d, rays.sun.xyz)), dot(d, rays.sun.xyz));
    rgb += rays.disk.rgb * clamp(0.5 + (rays.sun.w - gamma) / rays.disk.w, 0.0, 1.0);
    if (rays.down.w > 0.0) {
        rgb = mix(rays.below.rgb, rgb, clamp(0.5 + d.z / rays.disk.w, 0.0, 1.0));
    }
    // A 16-bit target holds at most 65504. Alpha is the leaves' coverage, so it is 0.
    return vec4f(min(rgb, vec3f(6e4)), 0.0);
}
