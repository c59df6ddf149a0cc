// Fits the shadow maps to what casts shadows: the boxes of the parts that move, and everything that stands still, which
// the CPU has measured. `shadow.rs` (`light_matrix`) does the same for points on the CPU.

struct Box {
    low: vec3f,
    high: vec3f,
}

struct Light {
    // The axes of a map, and the direction to the sun.
    x: vec3f,
    y: vec3f,
    to_sun: vec3f,
    // What stands still, along x, along y, and away from the sun.
    low: vec3f,
    high: vec3f,
}

@group(0) @binding(0) var<storage, read> parts: array<Box>;
@group(0) @binding(1) var<storage, read> lights: array<Light>;
// For each map the four columns of the matrix that draws it and of the one that reads it, sixteen entries apart; after
// the maps, the longest side of a texel.
@group(0) @binding(2) var<storage, read_write> fitted: array<vec4f>;
// x: how many texels wide and high the maps are drawn, in a corner of their texture. y: their share of its side.
@group(0) @binding(3) var<uniform> used: vec4f;

var<workgroup> lows: array<vec3f, WIDE>;
var<workgroup> highs: array<vec3f, WIDE>;

@compute @workgroup_size(WIDE)
fn fit_maps(@builtin(local_invocation_index) own: u32) {
    var longest = 0.0;
    for (var k = 0u; k < LAYERS; k++) {
        let light = lights[k];
        var low = light.low;
        var high = light.high;
        for (var n = own; n < arrayLength(&parts); n += WIDE) {
            let part = parts[n];
            if (part.low.x <= part.high.x) {
                let centre = 0.5 * (part.low + part.high);
                let sides = 0.5 * (part.high - part.low);
                let at = vec3f(dot(centre, light.x), dot(centre, light.y), -dot(centre, light.to_sun));
                let reach =
                    vec3f(dot(sides, abs(light.x)), dot(sides, abs(light.y)), dot(sides, abs(light.to_sun)));
                low = min(low, at - reach);
                high = max(high, at + reach);
            }
        }
        lows[own] = low;
        highs[own] = high;
        workgroupBarrier();
        for (var apart = WIDE / 2u; apart > 0u; apart /= 2u) {
            if (own < apart) {
                lows[own] = min(lows[own], lows[own + apart]);
                highs[own] = max(highs[own], highs[own + apart]);
            }
            workgroupBarrier();
        }
        if (own == 0u) {
            let size = max(highs[0] - lows[0], vec3f(1e-3));
            // A rim of two texels, and a little extra depth.
            let margin = vec3f(2.0 * size.xy / used.x, 0.02 * max(size.x, max(size.y, size.z)));
            let first = lows[0] - margin;
            let whole = size + 2.0 * margin;
            let x = vec4f(light.x * (2.0 / whole.x), -2.0 * first.x / whole.x - 1.0);
            let y = vec4f(light.y * (2.0 / whole.y), -2.0 * first.y / whole.y - 1.0);
            let depth = vec4f(-light.to_sun / whole.z, -first.z / whole.z);
            let last = vec4f(0.0, 0.0, 0.0, 1.0);
            let draws = transpose(mat4x4f(x, y, depth, last));
            let reads = transpose(mat4x4f(
                used.y * x + (used.y - 1.0) * last, used.y * y + (1.0 - used.y) * last, depth, last));
            for (var c = 0u; c < 4u; c++) {
                fitted[16u * k + c] = draws[c];
                fitted[16u * k + 4u + c] = reads[c];
            }
            longest = max(longest, max(whole.x, whole.y) / used.x);
        }
        workgroupBarrier();
    }
    if (own == 0u) {
        fitted[16u * LAYERS] = vec4f(longest);
    }
}
