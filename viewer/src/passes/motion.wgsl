// How far every pixel's surface has moved in the picture since an earlier time and camera.

struct Cameras {
    now: mat4x4f,
    before: mat4x4f,
    // Half the picture's width and height in pixels; the second is negative, because rows count downwards.
    half_size: vec4f,
}

@group(0) @binding(0) var<uniform> cameras: Cameras;
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
    // The same point in either camera's clip space. Both are linear over a triangle.
    @location(0) now: vec4f,
    @location(1) before: vec4f,
    //#if MASK
    @location(2) uv: vec2f,
    //#endif
}

@vertex
fn vertex(in: Vertex) -> Varying {
    let p = vec4f(in.position, 1.0);
    let rest = vec3f(dot(in.world_x, p), dot(in.world_y, p), dot(in.world_z, p));
    var now = rest;
    var before = rest;
    //#if BEND
    var number = 0u;
    //#if SECTIONS
    number = in.number;
    //#endif
    now = bent_at(0u, in.ride, number, rest, vec3f(0.0), vec3f(0.0)).position;
    before = bent_at(1u, in.ride, number, rest, vec3f(0.0), vec3f(0.0)).position;
    //#endif
    var out: Varying;
    out.position = cameras.now * vec4f(now, 1.0);
    out.now = out.position;
    out.before = cameras.before * vec4f(before, 1.0);
    //#if MASK
    out.uv = in.uv;
    //#endif
    return out;
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4f {
    //#if MASK
    if (textureSampleLevel(mask, mask_sampler, in.uv, 0.0).r < 0.5) {
        discard;
    }
    //#endif
    let moved = in.now.xy / in.now.w - in.before.xy / in.before.w;
    return vec4f(moved * cameras.half_size.xy, 0.0, 1.0);
}
