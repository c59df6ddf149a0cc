// What arrives at every anchor: a row is the sum of its entries times the light, column by column.

// Columns in x, rows in y.
@group(0) @binding(0) var<uniform> size: vec4u;
// Four half floats an entry: by way of other surfaces (red, green, blue), and straight from the sky.
@group(0) @binding(1) var<storage, read> entries: array<vec2u>;
// Of each column: what comes by way of other surfaces is of sky and sun, what comes straight of the sky alone.
@group(0) @binding(2) var<storage, read> light: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> arriving: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let row = id.x + 64u * groups.x * id.y;
    if (row >= size.y) {
        return;
    }
    var sum = vec3f(0.0);
    for (var k = 0u; k < size.x; k++) {
        let entry = entries[row * size.x + k];
        let red_green = unpack2x16float(entry.x);
        let blue_straight = unpack2x16float(entry.y);
        sum += vec3f(red_green, blue_straight.x) * light[2u * k].rgb + blue_straight.y * light[2u * k + 1u].rgb;
    }
    arriving[row] = vec4f(sum, 0.0);
}
