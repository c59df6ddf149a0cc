//! Scene manifests, the plan of what a scene needs, and the hand-over to the renderer.
