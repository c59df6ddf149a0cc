// The vertex data of passes that need only the place of a surface. `shadow.wgsl` and `motion.wgsl` follow it.

//#if MASK
@group(1) @binding(0) var mask: texture_2d<f32>;
@group(1) @binding(1) var mask_sampler: sampler;
//#endif

struct Vertex {
    @location(0) position: vec3f,
    //#if MASK
    @location(3) uv: vec2f,
    //#endif
    @location(4) world_x: vec4f,
    @location(5) world_y: vec4f,
    @location(6) world_z: vec4f,
    //#if BEND
    @location(7) ride: vec2f,
    @builtin(vertex_index) number: u32,
    //#endif
}

// The place of the vertex at rest, in world space.
fn at_rest(in: Vertex) -> vec3f {
    let p = vec4f(in.position, 1.0);
    return vec3f(dot(in.world_x, p), dot(in.world_y, p), dot(in.world_z, p));
}

//#if BEND
// Its place at one of the times that are stored.
fn stands_at(time: u32, in: Vertex) -> vec3f {
    return bent_at(time, in.ride, in.number, at_rest(in), vec3f(0.0), vec3f(0.0)).position;
}
//#endif

//#if MASK
fn is_cut_off(uv: vec2f) -> bool {
    return textureSampleLevel(mask, mask_sampler, uv, 0.0).r < 0.5;
}
//#endif
