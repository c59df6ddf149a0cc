// The maps of one side and the functions that read them. It is assembled twice: `$side` becomes `front` or `back`, `$n`
// the side's number, and `$-` a minus sign on the back only. The back's camera looks from behind. Its right is opposite
// to the mesh's tangent, its up is along the bitangent, and its z is opposite to the normal. So x and z change their
// sign.

//#if CURVE
@group(1) @binding($n0) var $side_curve: texture_2d<f32>;
@group(1) @binding($n1) var $side_gamma_delta: texture_2d<f32>;
//#endif
//#if MAPS
@group(1) @binding($n2) var $side_rho_d: texture_2d<f32>;
@group(1) @binding($n3) var $side_rho_t: texture_2d<f32>;
//#endif
//#if GLOSS_MAP
@group(1) @binding($n4) var $side_gloss: texture_2d<f32>;
//#endif
//#if NORMAL
@group(1) @binding($n5) var $side_normal: texture_2d<f32>;
//#endif
// Light that enters this side and leaves by the other, as vectors. The product of such a vector with the light's
// direction in the side's frame (bent, for the bent basis) is f. With a layer for each channel it is ρt·f.
//#if COLOUR
@group(1) @binding($n6) var $side_translucency: texture_2d_array<f32>;
//#else
//#if TRANSLUCENCY
@group(1) @binding($n6) var $side_translucency: texture_2d<f32>;
//#endif
//#endif

//#if LIT
// The direction in which this side's maps run, relative to the front's u and v.
const $side_mirror: vec2f = vec2f($-1.0, 1.0);

fn $side_reflectance(place: Place) -> vec3f {
    //#if CURVE
    let gamma_delta = at($side_gamma_delta, place.$side, $side_mirror, place);
    return gamma_delta.rgb * slab($side_curve, constants.$side_curve, constants.leaf.x + gamma_delta.a, 0);
    //#else
    //#if MAPS
    return at($side_rho_d, place.$side, $side_mirror, place).rgb;
    //#else
    return vec3f(0.0);
    //#endif
    //#endif
}

fn $side_transmittance(place: Place) -> vec3f {
    //#if CURVE
    let thickness = constants.leaf.x + at($side_gamma_delta, place.$side, $side_mirror, place).a;
    return slab($side_curve, constants.$side_curve, thickness, 1);
    //#else
    //#if MAPS
    return at($side_rho_t, place.$side, $side_mirror, place).rgb;
    //#else
    return vec3f(0.0);
    //#endif
    //#endif
}
//#endif

//#if TANGENT
// A normal of the map, in the scene.
fn $side_outward(n: vec3f, axes: Basis) -> vec3f {
    return normalize($-n.x * axes.tangent + n.y * axes.bitangent + $-n.z * axes.normal);
}

fn $side_mapped(place: Place, axes: Basis) -> vec3f {
    //#if NORMAL
    return $side_outward(at($side_normal, place.$side, $side_mirror, place).xyz, axes);
    //#else
    return $-axes.normal;
    //#endif
}
//#endif

//#if GLOSS
fn $side_gloss_at(place: Place) -> vec4f {
    //#if GLOSS_MAP
    return at($side_gloss, place.$side, $side_mirror, place);
    //#else
    return vec4f(0.0, 0.0, 0.0, 1.0);
    //#endif
}
//#endif

//#if SUN
//#if TRANSLUCENCY
// max(0, f)·ρt, or the colour map's value for both. `omega` is the light's direction in the front's frame.
fn $side_through(place: Place, omega: vec3f, transmittance: vec3f) -> vec3f {
    let own = vec3f($-omega.x, omega.y, $-omega.z);
    //#if COLOUR
    return max(vec3f(0.0), colour_at($side_translucency, place.$side, $side_mirror, place, own));
    //#else
    return max(0.0, dot(at($side_translucency, place.$side, $side_mirror, place).xyz, own)) * transmittance;
    //#endif
}
//#endif
//#endif

//#if SUPERSAMPLE
//#if NORMAL
// Highlight and cosine at a spot of the pixel, whose maps are read from these levels.
fn $side_spot(spot: vec2f, level: vec2f, facing: Facing) -> vec4f {
    let normal = $side_outward(textureSampleLevel($side_normal, map_sampler, spot, level.x).xyz, facing.axes);
    //#if GLOSS_MAP
    let gloss = textureSampleLevel($side_gloss, map_sampler, spot, level.y);
    //#else
    let gloss = vec4f(0.0, 0.0, 0.0, 1.0);
    //#endif
    return highlight(normal, gloss, facing.view);
}
//#endif

// The mean of highlight and cosine over the pixel. Where the normal turns by more than a fifth of the lobe's slope
// across the pixel, the highlight of the mean normal differs from the mean of the highlights. The error grows with the
// square of the turn; at a fifth it is 0.3 % to 1.3 %, by the lobe and by whether the normal turns along one axis or
// both. Of a pixel that is two texels wide or more, the turn is not asked, because that takes a third of the time of
// the highlights.
fn $side_mean_highlight(place: Place, facing: Facing, normal: vec3f, gloss: vec4f) -> vec4f {
    //#if NORMAL
    let texels = vec2f(textureDimensions($side_normal));
    let print = footprint(texels, $side_mirror, place);
    var level = vec2f(spot_level(texels, place), 0.0);
    let dx = $side_mirror * place.dx;
    let dy = $side_mirror * place.dy;
    if (print.lod < 1.0) {
        var turn = 0.0;
        for (var i = 0; i < 4; i++) {
            let by = select(dy * (f32(i) - 2.5), dx * (f32(i) - 0.5), i < 2);
            let there = textureSampleLevel($side_normal, map_sampler, place.$side + by, level.x).xyz;
            let d = $side_outward(there, facing.axes) - normal;
            turn = max(turn, dot(d, d));
        }
        let slope = max(gloss.a, 1e-3);
        if (4.0 * turn <= 0.04 * slope * slope) {
            return highlight(normal, gloss, facing.view);
        }
    }
    //#if GLOSS_MAP
    level.y = spot_level(vec2f(textureDimensions($side_gloss)), place);
    //#endif
    // Eight places that share no row, column or diagonal.
    var spots = array<vec2f, 8>(
        vec2f(0.0625, -0.1875), vec2f(-0.0625, 0.1875), vec2f(0.3125, 0.0625), vec2f(-0.1875, -0.3125),
        vec2f(-0.3125, 0.3125), vec2f(-0.4375, -0.0625), vec2f(0.1875, 0.4375), vec2f(0.4375, -0.4375));
    var sum = vec4f(0.0);
    for (var i = 0; i < 8; i++) {
        sum += $side_spot(place.$side + dx * spots[i].x + dy * spots[i].y, level, facing);
    }
    return 0.125 * sum;
    //#else
    return highlight(normal, gloss, facing.view);
    //#endif
}
//#endif
