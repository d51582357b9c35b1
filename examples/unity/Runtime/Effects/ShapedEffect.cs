using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Solid at the object's place: a spring to a proxy that stays outside of it.</summary>
    [AddComponentMenu("Tensionlab/Shaped")]
    public class ShapedEffect : HapticEffect
    {
        public enum Shape
        {
            Sphere,
            Box
        }

        public Shape shape = Shape.Sphere;
        [Tooltip("Diameter of a sphere is x; edges of a box, along the rig's axes; in m.")]
        public Vector3 size = new Vector3(0.2f, 0.2f, 0.2f);
        [Min(0f), Tooltip("Stiffness K_c, in N/m.")]
        public float stiffness = 400f;
        [Min(0f), Tooltip("Damping B_c, in N s/m.")]
        public float damping = 0f;

        protected override string Kind { get { return "shaped"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            var field = new Dictionary<string, object> { { "centre", rig.Point(transform.position) } };
            field["kind"] = shape == Shape.Sphere ? "sphere" : "box";
            if (shape == Shape.Sphere) field["radius"] = size.x / 2f;
            else field["size"] = rig.Lengths(size);
            parameters["field"] = field;
            parameters["coupling"] = new Dictionary<string, object>
            {
                { "stiffness", stiffness }, { "damping", damping }
            };
        }
    }
}
