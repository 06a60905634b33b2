// A woodpipe texture as a three.js material.
//
//   import { loadWood } from './wood_material.js';
//   const wood = await loadWood(THREE, 'NAME.json');
//   mesh.material = wood.material;             // lit by the scene's lights, color and roughness from the wood
//   wood.toBoard.makeScale(1, -1, -1);          // from the mesh's own frame to the board frame (y down, z away)
//
// The material is a MeshStandardMaterial: shadows, environment maps and fog work as with any other.

export async function loadWood(THREE, url) {
  const base = new URL(url, globalThis.location?.href ?? 'file:///');
  const about = await (await fetch(base)).json();
  const source = await (await fetch(new URL(about.shader, base))).text();
  const data = new Float32Array(await (await fetch(new URL(about.tables, base))).arrayBuffer());
  return makeWood(THREE, about, source, data);
}

export function makeWood(THREE, about, source, data) {
  const tables = new THREE.DataTexture(data, about.row, about.rows, THREE.RedFormat, THREE.FloatType);
  tables.minFilter = tables.magFilter = THREE.NearestFilter;
  tables.needsUpdate = true;
  const toBoard = new THREE.Matrix4();
  const material = new THREE.MeshStandardMaterial({ metalness: 0 });
  material.onBeforeCompile = (shader) => {
    shader.uniforms.wp_tables = { value: tables };
    shader.uniforms.wp_to_board = { value: toBoard };
    shader.vertexShader = shader.vertexShader
      .replace('#include <common>', '#include <common>\nuniform mat4 wp_to_board;\nvarying highp vec3 wp_point;')
      .replace('#include <begin_vertex>', '#include <begin_vertex>\nwp_point = (wp_to_board * vec4(position, 1.0)).xyz;');
    shader.fragmentShader = shader.fragmentShader
      .replace('#include <common>', `#include <common>\nvarying highp vec3 wp_point;\n${source}`)
      .replace(
        '#include <map_fragment>',
        `WpWood wood = wp_wood(wp_point, ${about.detail});\ndiffuseColor.rgb *= clamp(wood.rgb, 0.0, 1.0);`,
      )
      .replace(
        '#include <roughnessmap_fragment>',
        `float roughnessFactor = mix(${about.roughness.early.toFixed(4)}, ${about.roughness.late.toFixed(4)}, clamp(wood.lateness, 0.0, 1.0));`,
      );
  };
  return { material, tables, toBoard, about };
}
