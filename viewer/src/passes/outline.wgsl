// The vertex data of passes that need only the place of a surface. `shadow.wgsl` and `motion.wgsl` follow it.

//#if MASK
@group(1) @binding(0) var mask: texture_2d<f32>;
@group(1) @binding(1) var mask_sampler: sampler;
//#endif

struct Vertex {
    //#if OWN
    // From the point of the section that carries the vertex, in the scene's axes, with the section's number.
    @location(0) position: vec4f,
    //#else
    @location(0) position: vec3f,
    //#endif
    //#if MASK
    @location(3) uv: vec2f,
    //#endif
    //#if !OWN
    @location(4) world_x: vec4f,
    @location(5) world_y: vec4f,
    @location(6) world_z: vec4f,
    //#if BEND
    @location(7) ride: i32,
    //#endif
    //#endif
}

// The place of the vertex at rest, in world space or from its section's point.
fn at_rest(in: Vertex) -> vec3f {
    //#if OWN
    return in.position.xyz;
    //#else
    let p = vec4f(in.position, 1.0);
    return vec3f(dot(in.world_x, p), dot(in.world_y, p), dot(in.world_z, p));
    //#endif
}

//#if BEND
// Its place at one of the times that are stored.
fn stands_at(time: u32, in: Vertex) -> vec3f {
    //#if OWN
    let ride = i32(in.position.w);
    //#else
    let ride = in.ride;
    //#endif
    return bent_at(time, ride, at_rest(in), vec3f(0.0), vec3f(0.0)).position;
}
//#endif

//#if MASK
fn is_cut_off(uv: vec2f) -> bool {
    return textureSampleLevel(mask, mask_sampler, uv, 0.0).r < 0.5;
}
//#endif
