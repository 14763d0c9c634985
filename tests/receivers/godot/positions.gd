# Opens a GLB as Godot does at run time, and stores its vertices at each frame as 32-bit floats.
#     positions.gd -- FILE.glb OUT FRAMES FRAMES_PER_SECOND
extends SceneTree


func _initialize() -> void:
	var words := OS.get_cmdline_user_args()
	var document := GLTFDocument.new()
	var state := GLTFState.new()
	assert(document.append_from_file(words[0], state) == OK)
	var scene := document.generate_scene(state)
	root.add_child(scene)
	var player: AnimationPlayer = scene.find_children("*", "AnimationPlayer", true, false)[0]
	var face: MeshInstance3D = scene.find_children("*", "MeshInstance3D", true, false)[0]
	var mesh: ArrayMesh = face.mesh
	var rest: PackedVector3Array = mesh.surface_get_arrays(0)[Mesh.ARRAY_VERTEX]
	var shapes := mesh.surface_get_blend_shape_arrays(0)
	var is_relative := mesh.blend_shape_mode == Mesh.BLEND_SHAPE_MODE_RELATIVE
	var out := FileAccess.open(words[1], FileAccess.WRITE)
	player.play(player.get_animation_list()[0])
	for frame in int(words[2]):
		player.seek(frame / float(words[3]), true)
		var places := rest.duplicate()
		for number in mesh.get_blend_shape_count():
			var weight := face.get_blend_shape_value(number)
			if weight == 0.0:
				continue
			var shape: PackedVector3Array = shapes[number][Mesh.ARRAY_VERTEX]
			for v in places.size():
				places[v] += weight * (shape[v] if is_relative else shape[v] - rest[v])
		out.store_buffer(places.to_byte_array())
	out.close()
	print(JSON.stringify({"vertices": rest.size(), "shapes": mesh.get_blend_shape_count()}))
	quit()
