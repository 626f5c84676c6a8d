import cv2
import numpy as np
import pytest

from langwm_data.scenes.catalogue.catalogue import Catalogue
from langwm_data.scenes.catalogue.loading import load_mesh
from langwm_data.scenes.meshes.normals import face_vectors


def load(folder):
    (model,) = Catalogue.open(folder).models
    return load_mesh(model)


def heights_at_front_and_back(mesh):
    y = mesh.vertices[:, 1]
    return mesh.vertices[y > 0.74, 2].max(), mesh.vertices[y < -0.74, 2].max()


def test_a_model_has_its_stated_size_stands_upright_and_faces_the_front(write_catalogue):
    mesh = load(write_catalogue({}))
    assert mesh.vertices.min(axis=0) == pytest.approx([-0.5, -0.75, 0])
    assert mesh.vertices.max(axis=0) == pytest.approx([0.5, 0.75, 0.5])
    assert heights_at_front_and_back(mesh) == pytest.approx((0.25, 0.5))


def test_triangles_and_normals_look_outwards_after_all_turns(write_catalogue):
    for rotation in ("1 0 0 0 1 0 0 0 1", "0 0 1 0 1 0 -1 0 0", "1 0 0 0 0 1 0 -1 0"):
        mesh = load(write_catalogue({"modelRotation": rotation}))
        vertices = mesh.vertices.astype(float)
        a, b, c = np.moveaxis(vertices[mesh.triangles], 1, 0)
        volume = np.einsum("tk,tk->", a, np.cross(b, c)) / 6
        assert volume == pytest.approx(5 / 6 * 1 * 1.5 * 0.5)  # a step fills five sixths
        outward = face_vectors(vertices, mesh.triangles)
        assert (np.einsum("tck,tk->tc", mesh.normals[mesh.triangles], outward) > 0).all()


def test_the_stated_rotation_comes_first(write_catalogue):
    # A quarter turn about the file's y: what looked along its x now looks to the front.
    mesh = load(write_catalogue({"modelRotation": "-1 0 0 0 1 0 0 0 -1"}))
    assert heights_at_front_and_back(mesh) == pytest.approx((0.5, 0.25))


def test_materials_are_the_models_own(write_catalogue):
    textured, plain = load(write_catalogue({})).materials
    assert plain.color == (0.25, 0.5, 0.75)
    assert plain.opacity == 0.5
    picture = cv2.imdecode(np.frombuffer(textured.texture, np.uint8), cv2.IMREAD_COLOR_RGB)
    assert picture.shape == (2, 4, 3)
    assert picture[0, 0].tolist() == [255, 0, 0]  # red above


def test_a_texture_lies_the_right_way_round(write_catalogue):
    mesh = load(write_catalogue({}))
    top = mesh.triangles[: mesh.sizes[0]].ravel()
    at, uv = mesh.vertices[top], mesh.uvs[top]
    # In the file v grows towards the back and u to the viewer's right, which is the piece's left.
    assert (uv[:, 1] == (at[:, 1] < at[:, 1].mean())).all()
    assert (uv[:, 0] == (at[:, 0] < 0)).all()


def test_a_texture_that_is_not_there_leaves_the_plain_colour(write_catalogue):
    folder = write_catalogue({}, files={"step/step.mtl": "newmtl top\nKd 1 0 0\nmap_Kd /home/me/lost.png\n"})
    top, rest = load(folder).materials
    assert (top.texture, top.color) == (None, (1.0, 0.0, 0.0))
    assert rest.color == (0.8, 0.8, 0.8)


def test_clear_materials_vanish(write_catalogue):
    mesh = load(write_catalogue({}, files={"step/step.mtl": "newmtl rest\nd 0\n"}))
    assert mesh.sizes == (2,)
    assert len(mesh.vertices) == 4
    with pytest.raises(ValueError, match=r"tiny.sh3f!step/step.obj: every material of it is clear"):
        load(write_catalogue({}, files={"step/step.mtl": "newmtl rest\nd 0\nnewmtl top\nTr 1"}))


@pytest.mark.parametrize("path", ["/nested.zip", "/nested.zip!/deep/step.obj"])
def test_a_model_may_lie_in_an_archive_of_its_own(write_catalogue, nest, path):
    folder = write_catalogue({"model": path}, files={"nested.zip": nest("deep/step.obj")})
    mesh = load(folder)
    assert mesh.vertices.max(axis=0) == pytest.approx([0.5, 0.75, 0.5])
    assert mesh.materials[0].color == (0.8, 0.8, 0.8)


def test_an_archive_with_two_models_is_refused(write_catalogue, nest):
    folder = write_catalogue({"model": "a.zip"}, files={"a.zip": nest("a.obj", "b.obj")})
    with pytest.raises(ValueError, match=r"tiny.sh3f!a.zip: 2 OBJ files in it; exactly one is needed"):
        load(folder)


def test_damage_names_the_file(write_catalogue):
    folder = write_catalogue({}, files={"step/step.obj": "v 0 0 nan\nf 1 1 1\n"})
    with pytest.raises(ValueError, match=r"^tiny.sh3f!step/step.obj: has a 'v' that is no number"):
        load(folder)
    folder = write_catalogue({}, files={"step/stripes.png": b"GIF89a"})
    with pytest.raises(ValueError, match=r"^tiny.sh3f!step/stripes.png: a texture that is neither"):
        load(folder)
