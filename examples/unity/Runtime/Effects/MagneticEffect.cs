using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Magnetic surface, which draws the hand near along the object's y, and holds it there.</summary>
    [AddComponentMenu("Tensionlab/Magnetic")]
    public class MagneticEffect : HapticEffect
    {
        [Min(0f), Tooltip("Largest pull F_max, in N.")]
        public float maxForce = 3f;
        [Min(0.0001f), Tooltip("Distance h_max at which the pull begins, in m.")]
        public float reach = 0.1f;
        [Min(0f), Tooltip("Stiffness K at the surface, in N/m.")]
        public float stiffness = 300f;
        [Min(0f), Tooltip("Damping b, in N s/m.")]
        public float damping = 1f;

        protected override string Kind { get { return "magnetic"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["plane"] = Plane(rig);
            parameters["max_force"] = maxForce;
            parameters["reach"] = reach;
            parameters["stiffness"] = stiffness;
            parameters["damping"] = damping;
        }
    }
}
