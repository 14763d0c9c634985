# Runs anyface.gd on a mesh that is built here, and prints what its shapes and bone are after each frame.
extends SceneTree

const SHAPES := ["jawOpen", "eyeBlinkLeft", "mouthSmileLeft"]
const TURN := Quaternion(0.0, 0.6, 0.0, 0.8)

var _mesh := MeshInstance3D.new()
var _skeleton := Skeleton3D.new()


func _initialize() -> void:
	_mesh.mesh = triangle()
	root.add_child(_mesh)
	_skeleton.add_bone("Neck")
	_skeleton.set_bone_rest(0, Transform3D(Basis(TURN)))
	root.add_child(_skeleton)
	var face := Node.new()
	face.set_script(load("res://anyface.gd"))
	face.address = OS.get_cmdline_user_args()[0]
	face.mesh = _mesh
	face.skeleton = _skeleton
	face.head_bone = "Neck"
	root.add_child(face)


static func triangle() -> ArrayMesh:
	var arrays := []
	arrays.resize(Mesh.ARRAY_MAX)
	arrays[Mesh.ARRAY_VERTEX] = PackedVector3Array([Vector3.ZERO, Vector3.RIGHT, Vector3.UP])
	var shape := []
	shape.resize(Mesh.ARRAY_MAX)
	shape[Mesh.ARRAY_VERTEX] = PackedVector3Array([Vector3.UP, Vector3.RIGHT, Vector3.UP])
	var shapes := []
	var triangles := ArrayMesh.new()
	for name in SHAPES:
		triangles.add_blend_shape(name)
		shapes.append(shape)
	triangles.add_surface_from_arrays(Mesh.PRIMITIVE_TRIANGLES, arrays, shapes)
	return triangles


func _process(_delta: float) -> bool:
	var weights := []
	for number in SHAPES.size():
		weights.append(_mesh.get_blend_shape_value(number))
	var turn := TURN.inverse() * _skeleton.get_bone_pose_rotation(0)
	print(JSON.stringify({"weights": weights, "turn": [turn.x, turn.y, turn.z, turn.w]}))
	return false
