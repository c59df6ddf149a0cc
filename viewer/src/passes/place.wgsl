// Moves whole instances, once for each picture. What a section carries as a whole moves rigidly, so its transform can
// be moved instead of each of its vertices in each pass. `bend.wgsl` stands before this file.

// The three rows of each instance's object-to-world matrix, at rest.
@group(0) @binding(0) var<storage, read> rows: array<vec4f>;
@group(0) @binding(1) var<storage, read> rides: array<vec2f>;
// The same rows as the sections have moved them.
@group(0) @binding(2) var<storage, read_write> moved: array<vec4f>;

@compute @workgroup_size(256)
fn place(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&rides)) {
        return;
    }
    let x = rows[3u * k];
    let y = rows[3u * k + 1u];
    let z = rows[3u * k + 2u];
    let origin = vec3f(x.w, y.w, z.w);
    // Columns turn like directions. The scale is uniform, so normals turn with the moved rows too.
    let two = bent(rides[k], 0u, origin, vec3f(x.x, y.x, z.x), vec3f(x.y, y.y, z.y));
    let third = bent(rides[k], 0u, origin, vec3f(x.z, y.z, z.z), vec3f(0.0)).normal;
    moved[3u * k] = vec4f(two.normal.x, two.tangent.x, third.x, two.position.x);
    moved[3u * k + 1u] = vec4f(two.normal.y, two.tangent.y, third.y, two.position.y);
    moved[3u * k + 2u] = vec4f(two.normal.z, two.tangent.z, third.z, two.position.z);
}
