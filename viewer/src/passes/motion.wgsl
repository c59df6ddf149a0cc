// How far every pixel's surface has moved in the picture since an earlier time and camera.

struct Cameras {
    now: mat4x4f,
    before: mat4x4f,
    // Half the picture's width and height in pixels. The second is negative, because rows count downwards.
    half_size: vec4f,
}

@group(0) @binding(0) var<uniform> cameras: Cameras;
struct Varying {
    @builtin(position) position: vec4f,
    // The same point in the clip space of both cameras. Both values are linear over a triangle.
    @location(0) now: vec4f,
    @location(1) before: vec4f,
    //#if MASK
    @location(2) uv: vec2f,
    //#endif
}

@vertex
fn vertex(in: Vertex) -> Varying {
    let now = stands_at(0u, in);
    let before = stands_at(1u, in);
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
    if (is_cut_off(in.uv)) {
        discard;
    }
    //#endif
    let moved = in.now.xy / in.now.w - in.before.xy / in.before.w;
    return vec4f(moved * cameras.half_size.xy, 0.0, 1.0);
}
