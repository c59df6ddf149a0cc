// From radiance to an 8-bit picture: the channels of surfaces become sRGB's, then exposure, the curve for each channel,
// and sRGB encoding (IEC 61966-2-1).

struct Display {
    // Exposure; 1 for a film's curve, and 0 for Reinhard's x/(1 + x).
    curve: vec4f,
    // Red, green and blue from the channels of surfaces.
    red: vec4f,
    green: vec4f,
    blue: vec4f,
}

@group(0) @binding(0) var radiance: texture_2d<f32>;
@group(0) @binding(1) var<uniform> display: Display;

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

// A film's curve: dark below, steep in the middle, with a long shoulder (Narkowicz 2015, with its factor of .6).
fn film(exposed: vec3f) -> vec3f {
    let x = min(0.6 * exposed, vec3f(1e3));
    return min(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), vec3f(1.0));
}

@fragment
fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    // Alpha is the share of the pixel that surfaces cover. The rest is sky or background, which is sRGB already.
    let seen = textureLoad(radiance, vec2i(position.xy), 0);
    let bands = seen.rgb;
    let mapped = vec3f(dot(display.red.rgb, bands), dot(display.green.rgb, bands), dot(display.blue.rgb, bands));
    let x = display.curve.x * max(seen.rgb + seen.a * (mapped - seen.rgb), vec3f(0.0));
    if (display.curve.y > 0.0) {
        return vec4f(encode(film(x)), 1.0);
    }
    return vec4f(encode(x / (1.0 + x)), 1.0);
}
