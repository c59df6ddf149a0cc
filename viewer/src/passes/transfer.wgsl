// The light that arrives at every anchor: each row is the sum of its entries times the light, over the columns.

// x: number of columns, y: number of rows.
@group(0) @binding(0) var<uniform> size: vec4u;
// Four half floats in each entry: light by way of other surfaces (red, green, blue), and light straight from the sky.
@group(0) @binding(1) var<storage, read> entries: array<vec2u>;
// The light of each column, in two colours. Entries by way of other surfaces take that of sky and sun; straight entries
// take that of the sky alone.
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
