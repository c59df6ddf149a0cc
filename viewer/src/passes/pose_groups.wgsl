// The passes of a pose in which a group of invocations shares the work on each branch. They suit GPUs, on which a pass
// takes as long as its longest invocation. Two follow each other: every branch bends; its sections follow it and its
// ancestors. A third makes boxes. The results are those of `pose_alone.wgsl`, with the same formulas in the same order.

// Beams at marks that follow each other, the first of which is the last one of those before; the way of the axis to
// each of these marks, after the place of the first.
var<workgroup> beams: array<vec4f, LANES + 1u>;
var<workgroup> ways: array<vec3f, LANES + 1u>;

@compute @workgroup_size(LANES)
fn bend_limbs(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let k = group.x;
    let limb = limb_of(k);
    let bends = bends(k, limb);
    let e = bends.xyz;
    let size = bends.w;
    let own = vec2u(limbs[k].pieces.zw);
    if (lane == 0u) {
        states[k].bends = bends;
        let root = Mark(vec4f(pieces[own.x].begin.xyz, 0.0), vec4f(0.0, 0.0, 1.0, 0.0));
        marks[own.x + k] = root;
        beams[0] = root.beam;
        ways[0] = root.place.xyz;
    }
    for (var before = 0u; before < own.y; before += LANES) {
        let n = before + lane + 1u;
        let there = n <= own.y;
        let piece = pieces[own.x + min(n, own.y) - 1u];
        let next = pieces[own.x + min(n, own.y - 1u)];
        let x = select(1.0, next.begin.w, n < own.y);
        if (there) {
            beams[lane + 1u] = bent(limb, x, size, about(limb, x, size));
        }
        workgroupBarrier();
        let begin = select(0.0, piece.begin.w, n > 1u);
        let beam = beams[lane + 1u];
        if (there) {
            ways[lane + 1u] = gone(limb, piece.way.xyz, begin, x, e, beams[lane].xy, beam.xy);
        }
        workgroupBarrier();
        var place = ways[0];
        for (var m = 1u; m <= lane + 1u; m++) {
            place += ways[m];
        }
        if (size == 0.0) {
            let end = piece.begin.xyz + piece.way.xyz * ((x - piece.begin.w) * limb.length);
            place = select(end, next.begin.xyz, n < own.y);
        }
        if (there) {
            marks[own.x + k + n] = Mark(vec4f(place, x), beam);
        }
        workgroupBarrier();
        if (lane == LANES - 1u) {
            beams[0] = beam;
            ways[0] = place;
        }
        workgroupBarrier();
    }
}

// The branch and its ancestors, each with its root on its parent, before the parent's base moves it.
var<workgroup> joints: array<Rigid, LANES>;

// The motion of every section.
@compute @workgroup_size(LANES)
fn seat_sections(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let k = group.x;
    // Each invocation goes to another ancestor: the first to the branch itself. No branch has as many as invocations.
    var at = k;
    var ancestors = 0u;
    for (var parent = limbs[k].pieces.x; parent >= 0; parent = limbs[parent].pieces.x) {
        ancestors++;
        if (ancestors <= lane) {
            at = u32(parent);
        }
    }
    if (lane < ancestors) {
        joints[lane] = joint(at);
    }
    workgroupBarrier();
    var base = Rigid(vec3f(0.0), REST);
    var root = k;
    for (var n = 0u; n < ancestors; n++) {
        let by = joints[n];
        base = Rigid(by.to + rotate(by.turn, base.to), after(by.turn, base.turn));
        root = u32(limbs[root].pieces.x);
    }
    base.to = limbs[root].root.xyz + base.to;
    let seats = limbs[k].seats;
    let first_piece = u32(limbs[k].pieces.z);
    for (var n = seats.x + lane; n < seats.x + seats.y; n += LANES) {
        let seat = seat_of(n);
        if (n < seats.x + seats.z) {
            let mark = marks[first_piece + k + seat.place];
            seated(base, Rigid(mark.place.xyz, turned(limb_of(k), states[k].bends.xyz, mark.beam)), seat);
            continue;
        }
        let share = bitcast<f32>(seat.place);
        var piece = first_piece;
        for (var end = marks[piece + k + 1u].place.w; share > end && end < 1.0; end = marks[piece + k + 1u].place.w) {
            piece++;
        }
        seated(base, own(on_piece(k, piece), share), seat);
    }
}

var<workgroup> lows: array<vec3f, LANES>;
var<workgroup> highs: array<vec3f, LANES>;

// The box around everything that a branch carries: its bark and its leaves.
@compute @workgroup_size(LANES)
fn enclose_parts(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let own = limbs[group.x].seats.xy;
    var all = Box(vec3f(NOWHERE), vec3f(-NOWHERE));
    for (var n = own.x + lane; n < own.x + own.y; n += LANES) {
        let own_box = around(n);
        all = Box(min(all.low, own_box.low), max(all.high, own_box.high));
    }
    lows[lane] = all.low;
    highs[lane] = all.high;
    workgroupBarrier();
    for (var apart = LANES / 2u; apart > 0u; apart /= 2u) {
        if (lane < apart) {
            lows[lane] = min(lows[lane], lows[lane + apart]);
            highs[lane] = max(highs[lane], highs[lane + apart]);
        }
        workgroupBarrier();
    }
    if (lane == 0u) {
        parts[group.x] = Box(lows[0], highs[0]);
    }
}
