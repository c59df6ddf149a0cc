// Applies the vertex stage's `bent` to vertices and stores the results, so that a test can compare them with another
// computation.

// The section of each vertex.
@group(0) @binding(0) var<storage, read> rides: array<i32>;
// The place of each vertex from its section's point, its normal and its tangent; then all of them as moved.
@group(0) @binding(1) var<storage, read_write> vertices: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let k = 3u * id.x;
    if (k + 2u >= arrayLength(&vertices)) {
        return;
    }
    let moved = bent(rides[id.x], vertices[k].xyz, vertices[k + 1u].xyz, vertices[k + 2u].xyz);
    vertices[k] = vec4f(moved.position, 1.0);
    vertices[k + 1u] = vec4f(moved.normal, 0.0);
    vertices[k + 2u] = vec4f(moved.tangent, 0.0);
}
