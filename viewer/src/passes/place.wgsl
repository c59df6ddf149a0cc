// Moves whole instances. What a section carries as a whole moves rigidly, so its transform can
// be moved once for each picture, instead of each of its vertices in each pass. `bend.wgsl` stands before this file.

// The three rows of each instance's object-to-world matrix, at rest and from the section's point.
@group(0) @binding(0) var<storage, read> rows: array<vec4f>;
@group(0) @binding(1) var<storage, read> rides: array<i32>;
// The rows in world space as the sections have moved them.
@group(0) @binding(2) var<storage, read_write> moved: array<vec4f>;

@compute @workgroup_size(256)
fn place(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&rides)) {
        return;
    }
    // The scale is uniform, so normals turn with the moved rows too.
    let now = moved_rows(rides[k], Rows(rows[3u * k], rows[3u * k + 1u], rows[3u * k + 2u]));
    moved[3u * k] = now.x;
    moved[3u * k + 1u] = now.y;
    moved[3u * k + 2u] = now.z;
}
