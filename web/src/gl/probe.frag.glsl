#version 300 es
// White where the value a quarter of the way between two texels is what it should be.
precision highp float;
uniform highp sampler3D texels;
uniform vec2 expected;
out vec4 color;
void main() {
  float found = textureLod(texels, vec3(0.375, 0.5, 0.5), 0.0).x;
  color = vec4(abs(found - expected.x) <= expected.y ? 1.0 : 0.0);
}
