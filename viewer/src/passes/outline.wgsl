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
    //#if STAND
    @builtin(instance_index) instance: u32,
    //#else
    //#if !OWN
    @location(4) world_x: vec4f,
    @location(5) world_y: vec4f,
    @location(6) world_z: vec4f,
    //#if BEND
    @location(7) ride: i32,
    //#endif
    //#endif
    //#endif
}

// The place of the vertex at rest, in the world or in its plant's frame, or from its section's point; and that section
// or −1.
fn at_rest(in: Vertex) -> vec4f {
    //#if OWN
    //#if STAND
    return vec4f(in.position.xyz, f32(in_pose(plant_of(in.instance), i32(in.position.w))));
    //#else
    return in.position;
    //#endif
    //#else
    //#if STAND
    let at = leaf_of(in.instance);
    //#else
    //#if BEND
    let at = Standing(in.world_x, in.world_y, in.world_z, in.ride);
    //#else
    let at = Standing(in.world_x, in.world_y, in.world_z, -1);
    //#endif
    //#endif
    let p = vec4f(in.position, 1.0);
    return vec4f(dot(at.x, p), dot(at.y, p), dot(at.z, p), f32(at.ride));
    //#endif
}

// Its place at one of the times that are stored.
fn stands_at(time: u32, in: Vertex) -> vec3f {
    let rest = at_rest(in);
    var place = rest.xyz;
    //#if BEND
    place = bent_at(time, i32(rest.w), place, vec3f(0.0), vec3f(0.0)).position;
    //#endif
    //#if STAND
    place = on_land(plant_of(in.instance), place);
    //#endif
    return place;
}

//#if MASK
fn is_cut_off(uv: vec2f) -> bool {
    return textureSampleLevel(mask, mask_sampler, uv, 0.0).r < 0.5;
}
//#endif
