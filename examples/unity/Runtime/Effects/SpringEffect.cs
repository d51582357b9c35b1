using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Spring to the object's place. Continuous; passive.</summary>
    [AddComponentMenu("Tensionlab/Spring")]
    public class SpringEffect : HapticEffect
    {
        [Min(0f), Tooltip("Stiffness K, in N/m.")]
        public float stiffness = 30f;
        [Min(0f), Tooltip("Damping B, in N s/m.")]
        public float damping = 0f;

        protected override string Kind { get { return "spring"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["centre"] = rig.Point(transform.position);
            parameters["stiffness"] = stiffness;
            parameters["damping"] = damping;
        }
    }
}
