// From radiance to an 8-bit picture: exposure, Reinhard x/(1 + x) for each channel, sRGB encoding (IEC 61966-2-1).

@group(0) @binding(0) var radiance: texture_2d<f32>;
@group(0) @binding(1) var<uniform> exposure: vec4f;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    // One triangle that covers the picture.
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

fn encode(x: vec3f) -> vec3f {
    let low = 12.92 * x;
    let high = 1.055 * pow(max(x, vec3f(0.0031308)), vec3f(1.0 / 2.4)) - 0.055;
    return select(high, low, x <= vec3f(0.0031308));
}

@fragment
fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let x = exposure.x * textureLoad(radiance, vec2i(position.xy), 0).rgb;
    return vec4f(encode(x / (1.0 + x)), 1.0);
}
