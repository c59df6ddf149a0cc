// Chooses for each picture which instances are drawn, at which level of detail and how much enlarged, and sorts them by
// level. `thin.rs` and `detail.rs` do the same on the CPU, in the same order of operations. Three passes follow each
// other: each instance is judged and counted; counts become places; instances are written to their places. The order
// among the instances of a level is that of all instances, so a picture is the same each time it is drawn.

struct Plan {
    // The eye, and the angle of a pixel.
    eye: vec4f,
    // Unit vectors ahead, to the right and up. w: 1 with perspective; half the picture's sides at a distance of 1.
    ahead: vec4f,
    right: vec4f,
    up: vec4f,
    // The ball around the mesh.
    ball: vec4f,
    // x, y: how far beyond the picture's sides a ball of radius 1 is seen. z: error of the level in shadow maps (mm).
    // w: largest error in the picture (pixels).
    reach: vec4f,
    // Number of instances, of work groups, and of levels. w: 1 where instances may be left out at a distance, and 2
    // more where there are levels besides the mesh, for pictures or for shadow maps.
    numbers: vec4u,
    // x: largest distance of a level from the mesh (bits). y, z: first index and number of indices.
    levels: array<vec4u, LEVELS>,
}

struct Draw {
    indices: u32,
    instances: u32,
    first_index: u32,
    base_vertex: u32,
    first_instance: u32,
}

@group(0) @binding(0) var<uniform> plan: Plan;
// Rows of the instances at rest, from the point of the section that carries each, if one does.
@group(0) @binding(1) var<storage, read> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read> ranks: array<f32>;
// The size of each instance (bits), and its level with its place among those of its group. Level LEVELS is not drawn.
@group(0) @binding(3) var<storage, read_write> choices: array<vec2u>;
// For each group the number of instances at each level, and later the place of the first.
@group(0) @binding(4) var<storage, read_write> counts: array<array<u32, LEVELS>>;
@group(0) @binding(5) var<storage, read_write> draws: array<Draw, LEVELS>;
@group(0) @binding(6) var<storage, read_write> apart: atomic<u32>;
@group(0) @binding(7) var<storage, read_write> drawn: array<vec4f>;
//#if BEGINS
@group(0) @binding(8) var<storage, read> begins: array<vec2u>;
@group(0) @binding(9) var<storage, read_write> drawn_begins: array<vec2u>;
//#endif
// The centre of the ball around each instance at rest, from that point, and the instance's scale.
@group(0) @binding(10) var<storage, read> balls: array<vec4f>;
//#if BEND
// The section that carries each instance, or −1.
@group(0) @binding(11) var<storage, read> rides: array<i32>;
@group(0) @binding(12) var<storage, read> sections: array<array<vec4f, 2>>;
//#endif

fn inner(a: vec3f, b: vec3f) -> f32 {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

// `Seen::shows`.
fn shows(centre: vec3f, radius: f32) -> bool {
    if (plan.ahead.w == 0.0) {
        return true;
    }
    let to = centre - plan.eye.xyz;
    let along = inner(to, plan.ahead.xyz);
    return along >= -radius && abs(inner(to, plan.right.xyz)) <= along * plan.right.w + radius * plan.reach.x
        && abs(inner(to, plan.up.xyz)) <= along * plan.up.w + radius * plan.reach.y;
}

// `thin::enlarged`.
fn enlarged(wide: f32, rank: f32) -> f32 {
    let kept = max((wide / WIDE) * (wide / WIDE), FEWEST);
    if (kept >= 1.0) {
        return 1.0;
    }
    let fade = min(FADE * kept, 1.0 - kept);
    let own = clamp((kept - rank) / max(fade, 1e-6), 0.0, 1.0);
    return sqrt(own / (kept - 0.5 * fade));
}

fn error(level: u32) -> f32 {
    return bitcast<f32>(plan.levels[level].x);
}

fn far(a: vec3f, b: vec3f) -> f32 {
    return sqrt(inner(a - b, a - b));
}

var<workgroup> tallies: array<vec4u, 256>;
var<workgroup> most: atomic<u32>;

@compute @workgroup_size(256)
fn choose(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) own: u32,
    @builtin(workgroup_id) group: vec3u,
) {
    let k = id.x;
    var level = LEVELS;
    var size = 0.0;
    if (k < plan.numbers.x) {
        let ball = balls[k];
        let scale = ball.w;
        var centre = ball.xyz;
        //#if BEND
        let ride = rides[k];
        if (ride >= 0) {
            let by = moved_by(u32(ride));
            centre = by.to + rotate(by.turn, centre);
        }
        //#endif
        var radius = plan.ball.w * scale;
        size = 1.0;
        if ((plan.numbers.w & 1u) != 0u && plan.ahead.w != 0.0) {
            size = enlarged(2.0 * radius / max(plan.eye.w * far(plan.eye.xyz, centre), 1e-30), ranks[k]);
        }
        radius *= size;
        if (size > 0.0 && shows(centre, radius)) {
            let allowed = plan.reach.w * plan.eye.w * (far(plan.eye.xyz, centre) - radius);
            level = 0u;
            for (var n = 1u; n < plan.numbers.z; n++) {
                if (error(n) * scale * size <= allowed) {
                    level = n;
                }
            }
            if ((plan.numbers.w & 2u) != 0u) {
                atomicMax(&most, bitcast<u32>(error(level) * scale * size + plan.reach.z));
            }
        }
    }
    var mine = vec4u(0u);
    if (level < LEVELS) {
        mine[level >> 1u] = 1u << (16u * (level & 1u));
    }
    // How many of the group's instances up to this one have each level: sixteen bits for each.
    tallies[own] = mine;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step *= 2u) {
        var earlier = vec4u(0u);
        if (own >= step) {
            earlier = tallies[own - step];
        }
        workgroupBarrier();
        tallies[own] += earlier;
        workgroupBarrier();
    }
    if (k < plan.numbers.x) {
        let before = tallies[own] - mine;
        let place = (before[(level >> 1u) & 3u] >> (16u * (level & 1u))) & 0xffffu;
        choices[k] = vec2u(bitcast<u32>(size), (level << 16u) | place);
    }
    if (own < LEVELS) {
        counts[group.x][own] = (tallies[255][own >> 1u] >> (16u * (own & 1u))) & 0xffffu;
    }
    if (own == 0u) {
        atomicMax(&apart, atomicLoad(&most));
    }
}

var<workgroup> sums: array<u32, 256>;

// Turns the counts into places, one level after the other, and writes the draws.
@compute @workgroup_size(256)
fn sum_up(@builtin(local_invocation_index) own: u32) {
    let groups = plan.numbers.y;
    let share = (groups + 255u) / 256u;
    var base = 0u;
    for (var level = 0u; level < plan.numbers.z; level++) {
        var sum = 0u;
        for (var n = own * share; n < min((own + 1u) * share, groups); n++) {
            sum += counts[n][level];
        }
        sums[own] = sum;
        workgroupBarrier();
        for (var step = 1u; step < 256u; step *= 2u) {
            var earlier = 0u;
            if (own >= step) {
                earlier = sums[own - step];
            }
            workgroupBarrier();
            sums[own] += earlier;
            workgroupBarrier();
        }
        var place = base + sums[own] - sum;
        for (var n = own * share; n < min((own + 1u) * share, groups); n++) {
            let count = counts[n][level];
            counts[n][level] = place;
            place += count;
        }
        let all = sums[255];
        if (own == 0u) {
            let own_level = plan.levels[level];
            draws[level] = Draw(own_level.z, all, own_level.y, 0u, base);
        }
        base += all;
        workgroupBarrier();
    }
}

// `thin::larger`.
fn larger(row: vec4f, size: f32) -> vec4f {
    return vec4f(size * row.xyz, row.w + (1.0 - size) * inner(row.xyz, plan.ball.xyz));
}

@compute @workgroup_size(256)
fn gather(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= plan.numbers.x) {
        return;
    }
    let choice = choices[k];
    let size = bitcast<f32>(choice.x);
    let found = choice.y;
    let level = found >> 16u;
    if (level >= LEVELS) {
        return;
    }
    let place = counts[k / 256u][level] + (found & 0xffffu);
    var x = larger(rows[3u * k], size);
    var y = larger(rows[3u * k + 1u], size);
    var z = larger(rows[3u * k + 2u], size);
    //#if BEND
    let moved = moved_rows(rides[k], Rows(x, y, z));
    x = moved.x;
    y = moved.y;
    z = moved.z;
    //#endif
    drawn[3u * place] = x;
    drawn[3u * place + 1u] = y;
    drawn[3u * place + 2u] = z;
    //#if BEGINS
    drawn_begins[place] = begins[k];
    //#endif
}
