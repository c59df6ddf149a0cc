//! How the vertex stage reads its buffers.

use crate::passes::bend::{Carrier, Ride};

/// Layouts of the vertex buffers, in the order position, normal, tangent, uv, instance, ride, first row and first
/// share, place among anchors. A quantity whose argument is `false` is left out. Where sections carry vertices, each
/// position comes with its section, and there are no rows of an instance. Plants of a `stand` have rows elsewhere.
pub(crate) fn vertex_layouts(
    normal: bool,
    tangent: bool,
    uv: bool,
    ride: Option<Ride>,
    begin: bool,
    place: bool,
    stand: bool,
) -> Vec<Option<wgpu::VertexBufferLayout<'static>>> {
    const POSITION: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![0 => Float32x3];
    const NORMAL: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![1 => Float32x3];
    const TANGENT: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![2 => Float32x4];
    const UV: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![3 => Float32x2];
    const WORLD: [wgpu::VertexAttribute; 3] = wgpu::vertex_attr_array![4 => Float32x4, 5 => Float32x4, 6 => Float32x4];
    const RIDE: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![7 => Sint32];
    const CARRIED: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![0 => Float32x4];
    const BEGIN: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![9 => Uint32x2];
    const PLACE: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![8 => Float32x3];
    let layout =
        |array_stride, step_mode, attributes| Some(wgpu::VertexBufferLayout { array_stride, step_mode, attributes });
    let by_vertices = ride == Some(Ride::Vertices);
    let position: (u64, &'static [wgpu::VertexAttribute]) = if by_vertices { (16, &CARRIED) } else { (12, &POSITION) };
    let mut layouts = vec![layout(position.0, wgpu::VertexStepMode::Vertex, position.1)];
    if normal {
        layouts.push(layout(12, wgpu::VertexStepMode::Vertex, &NORMAL));
    }
    if tangent {
        layouts.push(layout(16, wgpu::VertexStepMode::Vertex, &TANGENT));
    }
    if uv {
        layouts.push(layout(8, wgpu::VertexStepMode::Vertex, &UV));
    }
    if !by_vertices && !stand {
        layouts.push(layout(48, wgpu::VertexStepMode::Instance, &WORLD));
    }
    if ride == Some(Ride::Instances) && !stand {
        layouts.push(layout(size_of::<Carrier>() as u64, wgpu::VertexStepMode::Instance, &RIDE));
    }
    if begin {
        layouts.push(layout(8, wgpu::VertexStepMode::Instance, &BEGIN));
    }
    if place {
        layouts.push(layout(12, wgpu::VertexStepMode::Vertex, &PLACE));
    }
    layouts
}
