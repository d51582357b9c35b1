using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Water below the object's surface: drag, and a lift.</summary>
    [AddComponentMenu("Tensionlab/Water")]
    public class WaterEffect : HapticEffect
    {
        [Min(0f), Tooltip("Linear drag b, in N s/m.")]
        public float linear = 2f;
        [Min(0f), Tooltip("Quadratic drag c, in N s²/m².")]
        public float quadratic = 3f;
        [Min(0f), Tooltip("Lift F_b, in N.")]
        public float lift = 1f;
        [Min(0.0001f), Tooltip("Depth from which on all of it is there, in m.")]
        public float mixing = 0.02f;

        protected override string Kind { get { return "water"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["surface"] = Plane(rig);
            parameters["linear"] = linear;
            parameters["quadratic"] = quadratic;
            parameters["lift"] = lift;
            parameters["mixing"] = mixing;
        }
    }
}
