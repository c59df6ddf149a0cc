// The slices as polygons that are sorted and blended.

//#if BILLBOARDS
// A board, or the whole ground, as a polygon.
struct Board {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) which: vec2i,
    @location(1) place: vec3f,
}

// The vertices of a board. `board` holds the axis that its slice stands across (NOTHING for the ground), the number of
// its plane, the number of the interval between planes of the other axis, and whether it is the upper half.
@vertex
fn board_vertex(@builtin(vertex_index) corner: u32, @location(0) board: vec4i) -> Board {
    let apart = steps_apart();
    let plane = (vec2f(board.yz) + 0.5) * apart - 0.5 * grass.period.xy;
    let end = vec2f(f32(corner & 1u), f32(corner >> 1u));
    let half = 0.5 * grass.base.w;
    var p = vec3f(mix(grass.corners.xy, grass.corners.zw, end), 0.01 * grass.base.w);
    if (board.x == i32(ACROSS_X)) {
        p = vec3f(plane.x, plane.y + end.x * apart.y, half * (f32(board.w) + end.y));
    } else if (board.x == i32(ACROSS_Y)) {
        let along = (f32(board.z) + 0.5 + end.x) * apart.x - 0.5 * grass.period.x;
        p = vec3f(along, (f32(board.y) + 0.5) * apart.y - 0.5 * grass.period.y, half * (f32(board.w) + end.y));
    } else if (board.x == i32(ACROSS_Z)) {
        p = vec3f(plane + end * apart, half);
    }
    p = vec3f(clamp(p.xy, grass.corners.xy, grass.corners.zw), p.z);
    return Board(frame.view_projection * vec4f(grass.base.xyz + p, 1.0), board.xy, p);
}

@fragment
fn board_fragment(board: Board) -> @location(0) vec4f {
    let ray = board.place - (frame.eye.xyz - grass.base.xyz);
    let d = normalize(ray);
    let level = level_at(length(ray));
    let all = overall();
    var hit = Struck(1.0, Both(vec3f(0.0), vec3f(0.0)));
    if (board.which.x == i32(NOTHING)) {
        hit.light = on_soil(vec3f(board.place.xy, 0.0), level, all);
        hit.light.sky *= grass.soil.rgb;
        hit.light.sun *= grass.soil.rgb;
    } else {
        let c = Crossing(0.0, u32(board.which.x), board.which.y, board.place);
        hit = struck(c, weights(d), level, d, all);
    }
    var radiance = hit.light.sky;
    //#if SUN
    //#if SHADOW
    hit.light.sun *= visibility(grass.base.xyz + board.place, frame.sun_direction.xyz, 1.0);
    //#endif
    radiance += hit.light.sun;
    //#endif
    return vec4f(held(radiance).rgb, hit.opacity);
}
//#endif
