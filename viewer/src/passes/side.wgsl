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
fn $side_covers_texels(place: Place) -> bool {
    //#if NORMAL
    return footprint(vec2f(textureDimensions($side_normal)), $side_mirror, place).lod >= 1.0;
    //#else
    return false;
    //#endif
}

fn $side_mapped(place: Place, axes: Basis) -> vec3f {
    //#if NORMAL
    let n = at($side_normal, place.$side, $side_mirror, place).xyz;
    return normalize($-n.x * axes.tangent + n.y * axes.bitangent + $-n.z * axes.normal);
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
