// Light that a camera's lens scatters over the picture. The picture is halved several times, and the halves are added
// up again from the smallest one. All weights sum to 1, so that light is only moved.

@group(0) @binding(0) var fine: texture_2d<f32>;
//#if BLEND
// A picture with half the pixels each way.
@group(0) @binding(1) var coarse: texture_2d<f32>;
// The share of the coarse picture in the first component.
@group(0) @binding(2) var<uniform> share: vec4f;
//#endif

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    // One triangle that covers the picture.
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

fn texel(picture: texture_2d<f32>, at: vec2i) -> vec4f {
    return textureLoad(picture, clamp(at, vec2i(0), vec2i(textureDimensions(picture)) - 1), 0);
}

@fragment
fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let here = vec2i(position.xy);
    var sum = vec4f(0.0);
    //#if BLEND
    // Linear between the middles of the coarse pixels.
    let first = (here + 1) / 2 - 1;
    for (var k = 0; k < 4; k++) {
        let at = first + vec2i(k & 1, k >> 1);
        // Middles are 2 pixels apart, and those of coarse pixel c lie at 2c + 1.
        let weight = vec2f(1.0) - 0.5 * abs(vec2f(here) + 0.5 - vec2f(2 * at + 1));
        sum += weight.x * weight.y * texel(coarse, at);
    }
    return mix(texel(fine, here), sum, share.x);
    //#else
    // Four pixels each way, with the weights 1, 3, 3, 1.
    for (var y = 0; y < 4; y++) {
        for (var x = 0; x < 4; x++) {
            let weight = vec2f(select(1.0, 3.0, x == 1 || x == 2), select(1.0, 3.0, y == 1 || y == 2)) / 8.0;
            sum += weight.x * weight.y * texel(fine, 2 * here + vec2i(x, y) - 1);
        }
    }
    return sum;
    //#endif
}
