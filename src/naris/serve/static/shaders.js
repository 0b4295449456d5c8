// The walls as naris draws them: naris.render.shading, formula by formula, for the graphics card.

// What every corner of the surface brings. Colours of regions are mixed between corners: borders follow no triangles.
const CORNER = /* glsl */ `
precision highp float;
in vec3 position;
in vec3 normal;
in float region;
uniform sampler2D palette;
out vec3 vTint;
vec3 colourOf(float number) {
  return texelFetch(palette, ivec2(int(number + 0.5), 0), 0).rgb;
}
uniform mat4 modelViewMatrix;
uniform mat4 projectionMatrix;
`;

/** Linear light behind the lens, before the sensor. */
export const WALL_VERTEX = /* glsl */ `
${CORNER}out vec3 vPoint;
out vec3 vNormal;
void main() {
  vPoint = position;
  vNormal = normal;
  vTint = colourOf(region);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

export const WALL_FRAGMENT = /* glsl */ `
precision highp float;
precision highp sampler3D;
in vec3 vPoint;
in vec3 vNormal;
in vec3 vTint;
out vec4 light;

uniform vec3 eye;         // mm, in the anatomy
uniform vec3 lamp;
uniform vec3 axis;        // unit, where the camera looks
uniform vec2 size;        // pixels
uniform float perPixel;   // size of a pixel at 1 mm
uniform sampler3D tissue, relief;
uniform sampler2D ramp, spot;
uniform mat3 turn;
uniform vec3 tissuePlace, reliefPlace;
uniform float tissuePerMm, reliefPerMm, edge, steps, rampBlood;
uniform float blood, blotches, vessels, fineVessels, vessel, fineVessel, mucus;
uniform vec3 mucusRgb, lightRgb, ambient, spotAmbient, wrap, attenuation;
uniform float reliefSlope, gloss, sheen, film, tissueRough, bounce, cosineCut, vignette, brightness, tint;

const float SHALLOWEST = 0.05;

vec4 noiseAt(sampler3D volume, vec3 at) {
  return texture(volume, (at + 0.5) / edge) * (127.0 / steps);
}

float line(float field, float width, float coarse) {
  float seen = sqrt(width * width + 0.25 * coarse * coarse);
  float t = max(1.0 - abs(field) / seen, 0.0);
  return t * t * (3.0 - 2.0 * t) * (width / seen);
}

float lobe(float facing, float alpha) {
  float q = alpha / (1.0 - facing * (1.0 - alpha));
  return q * q;
}

void main() {
  vec3 toEye = eye - vPoint;
  float far = length(toEye);
  vec3 view = toEye / far;
  vec3 n = normalize(gl_FrontFacing ? vNormal : -vNormal);
  float pixel = far * perPixel;

  vec3 inside = turn * vPoint;
  float coarse = pixel * reliefPerMm;
  float fade = 1.0 / (1.0 + coarse * coarse / 16.0);
  vec4 fine = noiseAt(relief, inside * reliefPerMm + reliefPlace);
  vec4 noise = noiseAt(tissue, inside * tissuePerMm + tissuePlace);
  float width = vessel * clamp(0.5 + 0.5 * noise.y, 0.05, 1.5);
  float spread = pixel * tissuePerMm;
  float amount = blood + blotches * noise.x;
  amount += vessels * (line(noise.z, width, spread) + 0.6 * line(noise.w, 0.6 * width, spread));
  amount += fineVessels * line(fine.x, fineVessel * clamp(0.6 - 0.6 * noise.y, 0.05, 1.5), coarse);
  vec3 albedo = texture(ramp, vec2((max(amount, 0.0) / rampBlood * 255.0 + 0.5) / 256.0, 0.5)).rgb;
  float cover = mucus * clamp(0.5 - 0.5 * noise.x + 0.5 * noise.y, 0.0, 1.0);
  albedo += cover * (mucusRgb - albedo);
  vec3 slope = (fine.yzw * fade) * turn; // from the right: turned back
  n = normalize(n - reliefSlope * (slope - dot(slope, n) * n));

  vec3 toLamp = lamp - vPoint;
  float r = length(toLamp);
  toLamp /= r;
  float cosine = clamp(dot(n, toLamp), SHALLOWEST, 1.0);
  float onAxis = -dot(toLamp, axis);
  float fall = onAxis >= cosineCut ? texture(spot, vec2(((1.0 - onAxis) * 0.5 * 511.0 + 0.5) / 512.0, 0.5)).r : 0.0;
  fall /= attenuation.x + r * (attenuation.y + r * attenuation.z);
  vec3 lit = spotAmbient + lightRgb * ((cosine + wrap) / (1.0 + wrap) + bounce * albedo);
  vec3 total = albedo * (ambient + fall * lit);
  float facing = clamp(dot(n, normalize(toLamp + view)), 0.0, 1.0);
  facing *= facing;
  total += fall * (gloss * lobe(facing, film) + sheen * lobe(facing, tissueRough)) * lightRgb;

  vec2 at = (gl_FragCoord.xy - 0.5 * size) / (0.5 * size.y);
  float corner = 1.0 + (size.x / size.y) * (size.x / size.y);
  float open = max(1.0 - vignette * dot(at, at) / corner, 0.0);
  float grey = dot(total, vec3(0.30, 0.59, 0.11));
  light = vec4(mix(total, grey * pow(vTint, vec3(2.2)) * 3.0, tint) * open * brightness, 1.0);
}`;

/** From light to grey levels: the gain of the exposure and the tone curve. */
export const SCREEN_VERTEX = /* glsl */ `
precision highp float;
in vec3 position;
out vec2 at;
void main() {
  at = position.xy * 0.5 + 0.5;
  gl_Position = vec4(position.xy, 0.0, 1.0);
}`;

export const DEVELOP_FRAGMENT = /* glsl */ `
precision highp float;
in vec2 at;
out vec4 grey;
uniform sampler2D light, tone;
uniform vec3 gain;
uniform float toneReach;
float toned(float x) {
  return texture(tone, vec2((min(sqrt(x) / toneReach, 1.0) * 1023.0 + 0.5) / 1024.0, 0.5)).r / 255.0;
}
void main() {
  vec3 x = max(texture(light, at).rgb * gain, 0.0);
  grey = vec4(toned(x.r), toned(x.g), toned(x.b), 1.0);
}`;

/** From a picture without distortion to one by a lens (Brown, k1 alone), by the inverse of what the lens does. */
export const BEND_FRAGMENT = /* glsl */ `
precision highp float;
in vec2 at;
out vec4 bent;
uniform sampler2D light;
uniform vec2 reach;       // the tangents of half the picture, as the lens bends them
uniform vec2 edge;        // those of half the picture that is bent
uniform float k1, vignette;
void main() {
  vec2 xy = 2.0 * at - 1.0, bentAt = xy * reach;
  float to = length(bentAt), r = to;
  for (int i = 0; i < 8; i++) r -= (r * (1.0 + k1 * r * r) - to) / (1.0 + 3.0 * k1 * r * r);
  vec2 straight = to > 0.0 ? bentAt * (r / to) : bentAt;
  float aspect = reach.x / reach.y;
  vec2 off = xy * vec2(aspect, 1.0);
  float open = max(1.0 - vignette * dot(off, off) / (1.0 + aspect * aspect), 0.0);
  bent = texture(light, 0.5 + 0.5 * straight / edge) * open;
}`;

/** The light itself, for the meter to read. */
export const COPY_FRAGMENT = /* glsl */ `
precision highp float;
in vec2 at;
out vec4 copied;
uniform sampler2D light;
void main() {
  copied = texture(light, at);
}`;

/** The anatomy from outside, as tinted glass: denser where it turns away from the eye. */
export const GLASS_VERTEX = /* glsl */ `
${CORNER}out vec3 vNormal;
out vec3 vView;
void main() {
  vec4 there = modelViewMatrix * vec4(position, 1.0);
  vNormal = mat3(modelViewMatrix) * normal;
  vView = -there.xyz;
  vTint = colourOf(region);
  gl_Position = projectionMatrix * there;
}`;

export const GLASS_FRAGMENT = /* glsl */ `
precision highp float;
in vec3 vNormal;
in vec3 vView;
in vec3 vTint;
out vec4 colour;
uniform float density;
void main() {
  float facing = abs(dot(normalize(vNormal), normalize(vView)));
  float edge = pow(1.0 - facing, 2.0);
  colour = vec4(vTint * (0.55 + 0.45 * facing), density * (0.25 + 0.75 * edge));
}`;
