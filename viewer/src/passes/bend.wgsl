//#if BEND
// Moves what sections carry: the leaves and the bark of plants. A section is a rigid motion: see `pose.wgsl`.
// `bend.rs` does the same as this file on the CPU. Sections may be stored for more than one time, one time after the
// other. Time 0 is the time that is drawn.

// Rigid motions: a point of each at rest, the place that it moves to, and a quaternion.
@group(2) @binding(0) var<storage, read> points: array<vec4f>;
@group(2) @binding(1) var<storage, read> sections: array<array<vec4f, 2>>;
// The section that carries each vertex of bark.
@group(2) @binding(2) var<storage, read> of_vertices: array<u32>;

struct Bent {
    position: vec3f,
    normal: vec3f,
    tangent: vec3f,
}

fn quaternion(q: vec4f, v: vec3f) -> vec3f {
    return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}

// Vertex `number` of its mesh, in world space. `ride.x` is a section, or −1 for none. `ride.y` is the first entry of
// the vertices' own sections, which are counted from this one; below 0, one section carries the whole mesh.
fn bent(ride: vec2f, number: u32, position: vec3f, normal: vec3f, tangent: vec3f) -> Bent {
    return bent_at(0u, ride, number, position, normal, tangent);
}

// The same at one of the times that are stored.
fn bent_at(time: u32, ride: vec2f, number: u32, position: vec3f, normal: vec3f, tangent: vec3f) -> Bent {
    if (ride.x < 0.0) {
        return Bent(position, normal, tangent);
    }
    var section = u32(ride.x);
    if (ride.y >= 0.0) {
        section += of_vertices[u32(ride.y) + number];
    }
    let at = section + time * SECTIONS;
    let before = points[at].xyz;
    let after = sections[at][0].xyz;
    let turn = sections[at][1];
    return Bent(after + quaternion(turn, position - before), quaternion(turn, normal), quaternion(turn, tangent));
}
//#endif
