// Depth along one direction of the sun's disk, orthographic.

@group(0) @binding(0) var<uniform> to_light: mat4x4f;
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
    //#endif
    //#if SECTIONS
    @builtin(vertex_index) number: u32,
    //#endif
}

struct Varying {
    @builtin(position) position: vec4f,
    //#if MASK
    @location(0) uv: vec2f,
    //#endif
}

@vertex
fn vertex(in: Vertex) -> Varying {
    let p = vec4f(in.position, 1.0);
    var out: Varying;
    var world = vec3f(dot(in.world_x, p), dot(in.world_y, p), dot(in.world_z, p));
    //#if BEND
    var number = 0u;
    //#if SECTIONS
    number = in.number;
    //#endif
    world = bent(in.ride, number, world, vec3f(0.0), vec3f(0.0)).position;
    //#endif
    out.position = to_light * vec4f(world, 1.0);
    //#if MASK
    out.uv = in.uv;
    //#endif
    return out;
}

//#if MASK
@fragment
fn fragment(in: Varying) {
    if (textureSampleLevel(mask, mask_sampler, in.uv, 0.0).r < 0.5) {
        discard;
    }
}
//#endif
