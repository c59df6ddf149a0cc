// The passes of a pose in which each invocation has a branch of its own, or a run of sections. They suit a software
// adapter. Four follow each other: every branch bends; joints sit on their parents; bases are carried along the
// hierarchy, and with them the sections where pieces begin; the other sections follow. A fifth makes boxes.

@compute @workgroup_size(64)
fn bend_limbs(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&limbs)) {
        return;
    }
    let limb = limb_of(k);
    let bends = bends(k, limb);
    let e = bends.xyz;
    let size = bends.w;
    states[k].bends = bends;
    let own = vec2u(limbs[k].pieces.zw);
    var piece = pieces[own.x];
    var mark = Mark(vec4f(piece.begin.xyz, 0.0), vec4f(0.0, 0.0, 1.0, 0.0));
    marks[own.x + k] = mark;
    for (var n = 1u; n <= own.y; n++) {
        let next = pieces[own.x + min(n, own.y - 1u)];
        let x = select(1.0, next.begin.w, n < own.y);
        let beam = bent(limb, x, size, about(limb, x, size));
        var place = mark.place.xyz + gone(limb, piece.way.xyz, mark.place.w, x, e, mark.beam.xy, beam.xy);
        if (size == 0.0) {
            let end = piece.begin.xyz + piece.way.xyz * ((x - piece.begin.w) * limb.length);
            place = select(end, next.begin.xyz, n < own.y);
        }
        piece = next;
        mark = Mark(vec4f(place, x), beam);
        marks[own.x + k + n] = mark;
    }
}

// The root of every branch on its parent.
@compute @workgroup_size(64)
fn join_limbs(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&limbs)) {
        return;
    }
    if (limbs[k].pieces.x >= 0) {
        let joint = joint(k);
        states[k].to = joint.to;
        states[k].turn = joint.turn;
    }
}

// The base of every branch, from the roots of all its ancestors.
@compute @workgroup_size(64)
fn carry_limbs(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&limbs)) {
        return;
    }
    var to = vec3f(0.0);
    var turn = REST;
    var at = k;
    for (var parent = limbs[k].pieces.x; parent >= 0; parent = limbs[at].pieces.x) {
        let own_turn = states[at].turn;
        to = states[at].to + rotate(own_turn, to);
        turn = after(own_turn, turn);
        at = u32(parent);
    }
    let base = Rigid(limbs[at].root.xyz + to, turn);
    states[k].base_to = base.to;
    states[k].base_turn = base.turn;
    // The sections on marks need nothing that is not known.
    let seats = limbs[k].seats;
    let first_mark = u32(limbs[k].pieces.z) + k;
    let limb = limb_of(k);
    let e = states[k].bends.xyz;
    for (var n = seats.x; n < seats.x + seats.z; n++) {
        let seat = seat_of(n);
        let mark = first_mark + seat.place;
        seated(base, Rigid(marks[mark].place.xyz, turned(limb, e, marks[mark].beam)), seat);
    }
}

// The motion of every other section.
@compute @workgroup_size(64)
fn seat_sections(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= arrayLength(&runs)) {
        return;
    }
    let run = runs[id.x];
    var piece = run.y;
    var on = on_piece(run.x, piece);
    let base = Rigid(states[run.x].base_to, states[run.x].base_turn);
    for (var n = run.z; n < run.z + run.w; n++) {
        let seat = seat_of(n);
        let share = bitcast<f32>(seat.place);
        if (share > on.end.place.w && on.end.place.w < 1.0) {
            piece++;
            on = On(on.limb, pieces[piece].way.xyz, on.end, marks[piece + run.x + 1u], on.bends);
        }
        seated(base, own(on, share), seat);
    }
}

// The box around everything that a branch carries: its bark and its leaves.
@compute @workgroup_size(64)
fn enclose_parts(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if (k >= arrayLength(&limbs)) {
        return;
    }
    let own = limbs[k].seats.xy;
    var all = Box(vec3f(NOWHERE), vec3f(-NOWHERE));
    for (var n = own.x; n < own.x + own.y; n++) {
        let own_box = around(n);
        all = Box(min(all.low, own_box.low), max(all.high, own_box.high));
    }
    parts[k] = all;
}
