// Bark and ground: diffuse surfaces of one colour that transmit nothing. The inside is black.

// The reflectance.
@group(1) @binding(0) var<uniform> albedo: vec4f;

@fragment
fn fragment(in: Varying, @builtin(front_facing) front_facing: bool) -> @location(0) vec4f {
    var radiance = vec3f(0.0);
    //#if LIT
    let across = cross(dpdx(in.world), dpdy(in.world));
    let facing = faced(in, front_facing, across);
    if (facing.front) {
        let normal = facing.towards_viewer;
        var seen = Shade(vec3f(0.0), vec3f(0.0));
        //#if TRANSFER
        seen.ambient = albedo.rgb * max(vec3f(0.0), in.arrived) * 0.318309886;
        //#else
        //#if DOME
        seen.ambient = albedo.rgb * even_light(normal);
        //#else
        //#if SKY
        seen.ambient = frame.sky.rgb * albedo.rgb;
        //#endif
        //#endif
        //#endif
        //#if SUN
        seen.sunlit = max(0.0, dot(normal, frame.sun_direction.xyz)) * albedo.rgb * 0.318309886;
        //#endif
        radiance = lit(seen, facing, in.world);
        //#if SCANNER
        radiance += under_tube(Scanned(normal, albedo.rgb), facing.view, in.world);
        //#endif
    }
    //#endif
    return held(radiance);
}
